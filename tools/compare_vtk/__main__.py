"""Draws one scene with VTK and with Ashfall: what each setting costs, and how near it comes to the truth.

Run by tools/compare-vtk, whose --help teaches it.
"""

import argparse
import json
import sys
from pathlib import Path
from statistics import median_low

import numpy as np

import draw
from ashfall import PLAIN_CASTER, PLAIN_CASTER_NAME, Ashfall
from picture import psnr_db, write_png
from refusal import MACHINE, Refusal, Said
from row import Row
from scene import Scene
from store import read_channel
from tables import Comparison

STEPS = [2, 1, 0.5, 0.25, 0.125]


class VtkProgram:
    """A mapper with voxels of one type, and its measurements."""

    def __init__(self, mapper, as_f32, own_type):
        self.mapper = mapper
        self.as_f32 = as_f32
        self.name = f"VTK {mapper}, {'f32' if as_f32 else own_type}"
        if mapper == draw.GPU:
            self.name += ", f32 frame" if as_f32 else ", 8 bit frame"
        self.times = {step: [] for step in STEPS}
        self.pictures = {}

    def measure(self, repeats, grid, camera, scene):
        """Adds `repeats` frames of every step to what is known; window and driver."""
        canvas = draw.Canvas(grid, camera, scene.size, scene.background, self.mapper, self.as_f32)
        for step in STEPS:
            progress(f"{self.name}, step {step:g}")
            # Compiles, and makes the tables of the step.
            canvas.draw(step)
            self.times[step] += [canvas.draw(step) for _ in range(repeats)]
            self.pictures[step] = canvas.picture().astype(np.float32)
        machine = draw.machine(canvas)
        canvas.close()
        return machine

    def row(self, step, truth):
        """Of one step."""
        processor, wall = (median_low(times) for times in zip(*self.times[step]))
        return Row(self.name, f"step {step:g}", processor, wall, psnr_db(self.pictures[step], truth))


def main():
    arguments = parsed()
    folder = arguments.output
    folder.mkdir(parents=True, exist_ok=True)
    scene_flags = ["--size", "x".join(map(str, arguments.size))] if arguments.size else []
    scene_flags += ["--view", arguments.view] if arguments.view else []
    ashfall = Ashfall(arguments.binary, arguments.scene, scene_flags, arguments.repeats, folder)
    ashfall.check_scene()
    scene = Scene(arguments.scene, arguments.view, arguments.size)
    voxels = ashfall.import_volume(scene.source, scene.import_flags())
    try:
        volume = read_channel(voxels, scene.channel.get("index", 0))
    finally:
        voxels.unlink()
    grid, camera = scene.grid(volume)
    with_flags = getattr(arguments, "with")
    for flags in with_flags:
        ashfall.check_flags(flags)
    draw.be_quiet()

    own_type = grid.voxels.dtype.kind + str(8 * grid.voxels.dtype.itemsize)
    programs = [VtkProgram(draw.GPU, False, own_type), VtkProgram(draw.GPU, True, own_type)]
    programs += [VtkProgram(draw.FIXED_POINT, False, own_type)]
    programs += [VtkProgram(draw.FIXED_POINT, True, own_type)] if own_type != "f32" else []
    # Before and after the others, so that a machine that changes in between is noticed.
    before, after = arguments.repeats - arguments.repeats // 2, arguments.repeats // 2
    for program in programs:
        machine = program.measure(before, grid, camera, scene)
        if program is programs[0]:
            window, driver = machine
    progress("Ashfall's usual sweep")
    found, rows, truth = ashfall.study("usual", "")
    progress("Ashfall as a plain caster")
    _, plain, _ = ashfall.study("plain-caster", PLAIN_CASTER)
    for row in plain:
        row.program = PLAIN_CASTER_NAME
    rows = plain + rows
    for number, flags in enumerate(with_flags):
        progress(f"Ashfall with {flags}")
        rows += ashfall.study(f"with-{number}", flags)[1]
    for program in programs if after else []:
        program.measure(after, grid, camera, scene)

    truth = truth[:, :, :3]
    vtk_rows = [program.row(step, truth) for program in programs for step in STEPS]
    base = vtk_rows[STEPS.index(1)]
    facts = {
        "scene": scene.path.name,
        "view": scene.view_name,
        "size": scene.size,
        "voxels": f"{' x '.join(map(str, grid.size))} of {own_type}",
        "repeats": arguments.repeats,
        "vtk": draw.version(),
        "vtk_window": window,
        "vtk_driver": driver,
        "ashfall": ashfall.version(),
        "ashfall_device": found["device"],
        "ashfall_driver": found["driver"],
        "ashfall_early_stop": found["early_stop"],
    }
    caster = next(row for row in plain if row.setting == "step 1")
    comparison = Comparison(facts, vtk_rows + rows, base, caster, drift(programs[0].times[1], before))
    write_pictures(folder, programs, truth)
    text, table = json.dumps(comparison.json(), indent=2) + "\n", comparison.text()
    (folder / "compare.json").write_text(text)
    (folder / "tables.md").write_text(table)
    sys.stdout.write(text if arguments.json else table)


def parsed():
    """What tools/compare-vtk has checked."""
    parser = argparse.ArgumentParser(prog="compare-vtk")
    parser.add_argument("scene", type=Path)
    parser.add_argument("--binary", required=True)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--size", type=lambda text: [int(edge) for edge in text.split("x")])
    parser.add_argument("--view")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--with", action="append", default=[])
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


def drift(times, before):
    """Of the frame that is 1, after the others over before them."""
    if before == len(times):
        return None
    processor, wall = ([median_low(part) for part in (of[:before], of[before:])] for of in zip(*times))
    return {"ratio": processor[1] / processor[0], "wall_ratio": wall[1] / wall[0]}


def write_pictures(folder, programs, truth):
    """Of VTK, and of the truth, to look at."""
    write_png(folder / "truth.png", truth)
    for program in programs:
        for step, picture in program.pictures.items():
            name = f"{program.name}, step {step:g}".lower().replace(", ", "-").replace(" ", "-")
            write_png(folder / f"{name}.png", picture)


def progress(words):
    print(f"compare-vtk: {words}", file=sys.stderr, flush=True)


def ended():
    """The exit code."""
    try:
        main()
    except Refusal as refusal:
        progress(str(refusal))
        return refusal.code
    except Said as said:
        return said.code
    except OSError as why:
        progress(f"{why.filename}: {why.strerror}; choose another -o, or see to the disk")
        return MACHINE
    return 0


if __name__ == "__main__":
    sys.exit(ended())
