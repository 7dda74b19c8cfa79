"""Runs `ashfall study` for scenes, and writes what came of them as a page with charts.

Run by tools/studies, whose --help teaches it.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

from page import page

CHARTS = {"study.svg": "{}.svg", "streaming.svg": "{}-streaming.svg"}
MACHINE = 4


class Ended(Exception):
    """With a code; what is to be said has been said."""


def main():
    arguments = parsed()
    names, scenes = zip(*(scene.split("=", 1) for scene in arguments.scenes))
    if len(set(names)) < len(names):
        say("two scenes have one name: rename one")
        return 2
    studies = []
    for number, (name, scene) in enumerate(zip(names, scenes), 1):
        say(f"{name}, {number} of {len(names)}")
        folder = arguments.output / name
        studies.append((name, study(arguments.binary, scene, folder, arguments.flags), noted(folder)))
    arguments.docs.mkdir(parents=True, exist_ok=True)
    for name in names:
        for chart, of_scene in CHARTS.items():
            source = arguments.output / name / chart
            if source.exists():
                shutil.copyfile(source, arguments.docs / of_scene.format(name))
    readme = arguments.docs / "README.md"
    readme.write_text(page(studies, " ".join(arguments.flags)), encoding="utf-8")
    say(f"wrote {readme}")
    return 0


def parsed():
    """What tools/studies has checked."""
    parser = argparse.ArgumentParser(prog="studies")
    # NAME=PATH.
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--binary", required=True)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--docs", type=Path, required=True)
    own, flags = sys.argv[1:], []
    if "--" in own:
        flags = own[own.index("--") + 1 :]
        own = own[: own.index("--")]
    arguments = parser.parse_args(own)
    arguments.flags = flags
    return arguments


def study(binary, scene, folder, flags):
    """What study.json holds, once all is measured."""
    folder.mkdir(parents=True, exist_ok=True)
    begun, load = time.monotonic(), os.getloadavg()[0]
    words = [binary, "study", scene, "-o", str(folder), *flags]
    code = subprocess.run(words, stdout=subprocess.DEVNULL, check=False).returncode
    if code != 0:
        # It has said why, on stderr.
        raise Ended(code if code > 0 else MACHINE)
    found = json.loads((folder / "study.json").read_text(encoding="utf-8"))
    if found["measured_now"] > 0:
        note(folder, binary, time.monotonic() - begun, load)
    return found


def note(folder, binary, seconds, load):
    """Keeps with what, when and for how long was measured; a study may take several runs."""
    version = subprocess.run([binary, "--version"], capture_output=True, text=True, check=False)
    before = noted(folder)
    (folder / "machine.json").write_text(
        json.dumps(
            {
                "version": version.stdout.strip(),
                "cpu": cpu(),
                "cores": os.cpu_count(),
                "day": time.strftime("%Y-%m-%d"),
                "seconds": before.get("seconds", 0) + seconds,
                # Of everything on the machine, before this began: what else it did.
                "load": max(before.get("load", 0), load),
            }
        )
    )


def noted(folder):
    """What `note` has kept."""
    try:
        return json.loads((folder / "machine.json").read_text())
    except FileNotFoundError:
        return {}


def cpu():
    """Its name, where the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return "a CPU"
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else "a CPU"


def say(words):
    print(f"studies: {words}", file=sys.stderr, flush=True)


def ended():
    """The exit code."""
    try:
        return main()
    except Ended as code:
        return code.args[0]
    except OSError as why:
        say(f"{why.filename}: {why.strerror}; choose another -o or --docs, or see to the disk")
        return MACHINE


if __name__ == "__main__":
    sys.exit(ended())
