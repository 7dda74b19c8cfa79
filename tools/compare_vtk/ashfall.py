"""Runs the binary: voxels out of any format, and error against time of its own settings.

`ashfall study` draws every setting again and again with its voxels on the device, and leaves the f64
reference in a file, so that VTK's pictures are held against the same truth.
"""

import json
import math
import shlex
import shutil
import subprocess

import numpy as np

from refusal import ARGUMENTS, MACHINE, Refusal, Said
from row import Row

# Beyond VTK's coarsest, since smooth scenes are near the truth with steps of several voxels.
STEPS = "8,4,3,2,1,0.5,0.25,0.125"
TOLERANCES = "0.3,0.2,0.1,0.05,0.03,0.02,0.01,0.005,0.003,0.002,0.001"
# 140 dB: far beyond what any picture here reaches.
REFERENCE_ERROR_MAX = "1e-7"
# What `ashfall render` calls by the first name, `ashfall study` sweeps by the second.
SWEPT = {"--integrator": "--integrators", "--step": "--steps", "--tolerance": "--tolerances"}
# The textbook's program, against which the others may be held.
PLAIN_CASTER = "--addressing direct --no-skipping --integrator riemann --filter hardware --step 1"
PLAIN_CASTER_NAME = "ashfall, plain caster"


class Ashfall:
    """The binary, and what all its runs have in common."""

    def __init__(self, binary, scene_path, scene_flags, repeats, folder):
        self.binary = binary
        self.scene_path = scene_path
        self.scene_flags = scene_flags
        self.repeats = repeats
        self.folder = folder

    def version(self):
        """Its name and version."""
        return subprocess.run([self.binary, "--version"], capture_output=True, text=True).stdout.strip()

    def check_scene(self):
        """Ends with Ashfall's own sentence where the scene cannot be drawn."""
        picture = self.folder / "checked.png"
        # One pixel; a size on the command line is checked too, by the studies.
        flags = ["--size", "1x1", "--error-max", "0.1", "-o", str(picture)]
        self._run(["reference", str(self.scene_path), *flags])
        for file in self.folder.glob("checked*.png"):
            file.unlink()

    def check_flags(self, flags):
        """Ends with Ashfall's own sentence where it does not know these, before anything takes long."""
        view = self.scene_flags[self.scene_flags.index("--view") :] if "--view" in self.scene_flags else []
        quick = Ashfall(self.binary, self.scene_path, ["--size", "4x4", *view], 1, self.folder)
        quick.study("check", flags)
        shutil.rmtree(self.folder / "study-check")

    def import_volume(self, source, flags):
        """A store of the source, its bricks not compressed; whoever asks removes it."""
        store = self.folder / "voxels.bricks"
        self._run(["import", str(source), "-o", str(store), "--compress", "none", "--brick", "256", *flags])
        return store

    def study(self, name, flags):
        """Rows of a sweep that differs from the usual one by flags of `ashfall render`, and its reference."""
        folder = self.folder / f"study-{name}"
        # Times of another day are not compared: nothing is taken from a journal.
        shutil.rmtree(folder, ignore_errors=True)
        swept, other = study_flags(flags)
        usual = {"--steps": STEPS, "--tolerances": TOLERANCES, "--only": "step", "--error-max": REFERENCE_ERROR_MAX}
        usual.update({"--repeats": str(self.repeats), **swept})
        listed = [word for pair in usual.items() for word in pair]
        self._run(["study", str(self.scene_path), "-o", str(folder), *listed, *other, *self.scene_flags])
        found = json.loads((folder / "study.json").read_text())
        # A study sweeps without early stop too. VTK ends rays early, and so does what is compared; with a
        # tolerance both are, since rays then end at a quarter of it, which may be most of the error.
        settings = [one for one in found["settings"] if one["measured"]]
        early_stop = max(one["setting"]["early_stop"] for one in settings)
        kept = [
            one
            for one in settings
            if one["setting"]["early_stop"] == early_stop or one["setting"]["tolerance"] is not None
        ]
        rows = [row_of(one, found["clock"], other) for one in kept]
        return {**found, "early_stop": early_stop}, rows, np.load(folder / "reference_level_0.npy")

    def _run(self, words):
        try:
            code = subprocess.run([self.binary, *words], stdout=subprocess.DEVNULL, check=False).returncode
        except OSError as why:
            raise Refusal(MACHINE, f"{self.binary}: cannot be run: {why}") from why
        if code != 0:
            # It has said why, on stderr.
            raise Said(code if code > 0 else MACHINE)


def study_flags(text):
    """Flags of `ashfall render` as those of `ashfall study`: what is swept, and the rest."""
    try:
        words = shlex.split(text)
    except ValueError as why:
        raise Refusal(ARGUMENTS, f"--with: {text!r} cannot be read: {why}") from why
    swept, other = {}, []
    while words:
        name, equals, value = words.pop(0).partition("=")
        if name not in SWEPT:
            other.append(name + equals + value)
            continue
        if not equals:
            if not words:
                raise Refusal(ARGUMENTS, f"--with: {name} needs a value")
            value = words.pop(0)
        swept[SWEPT[name]] = value
    return swept, other


def row_of(one, clock, flags):
    """A setting of study.json as a row."""
    setting, measured = one["setting"], one["measured"]
    words = "step {:g}".format(setting["step"])
    if setting["tolerance"] is not None:
        words = "tolerance {:g}".format(setting["tolerance"])
        words += ", early stop" if setting["early_stop"] > 0 else ""
    program = " ".join(["ashfall,", setting["integrator"], *flags])
    # Where the device is no CPU, `ms` counts the wall's time.
    processor = measured["ms"]["median"] if clock == "processor" else None
    psnr_db = measured["error"]["whole"]["psnr_db"]
    if psnr_db is None:
        psnr_db = math.inf
    return Row(program, words, processor, measured["wall_ms"]["median"], psnr_db)
