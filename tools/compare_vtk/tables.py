"""The comparison in words and as JSON."""

import math

TARGETS_DB = [40, 50, 60]
ASHFALL = "ashfall, all of these"
EXPLAINED = [
    "VTK: Render() until its driver is done; Ashfall: from the first recording to the picture in",
    "host memory, its voxels on the device before. A frame before warms up; loading, set-up and",
    "compilation do not count. ms: processor time of the process, where the CPU draws everything.",
    "dB: PSNR over linear rgb against the f64 reference.",
]


class Comparison:
    """All rows, and the two whose time is 1: VTK's at its default, and the plain caster's."""

    def __init__(self, facts, rows, base, plain, drift):
        self.facts = facts
        self.rows = rows
        self.base = base
        self.plain = plain
        # Time of the base after all other programs over the same before; None where it was not repeated.
        self.drift = drift
        # Where it is told, it counts: other work on the machine does not change what a process is charged.
        self.by_processor = all(row.processor_ms is not None for row in rows)

    def ratio(self, row, base=None):
        """Of the time that counts, to VTK's unless said."""
        base = base or self.base
        if self.by_processor:
            return row.processor_ms / base.processor_ms
        return row.wall_ms / base.wall_ms

    def wall_ratio(self, row):
        """Of the wall's time."""
        return row.wall_ms / self.base.wall_ms

    def cheapest(self, program, psnr_db):
        """The fastest row of a program that is so near to the truth; None where none is."""
        near = [row for row in self._of(program) if row.psnr_db >= psnr_db]
        return min(near, key=self.ratio, default=None)

    def programs(self):
        """Their names, in order; the last stands for all of Ashfall's."""
        return [*dict.fromkeys(row.program for row in self.rows), ASHFALL]

    def _of(self, program):
        if program == ASHFALL:
            return [row for row in self.rows if row.program.startswith("ashfall,")]
        return [row for row in self.rows if row.program == program]

    def json(self):
        """One object; decibels that have no finite value are null."""
        return {
            "format": 1,
            **self.facts,
            "clock": "processor" if self.by_processor else "wall",
            "drift": self.drift,
            "rows": [self._row(row) for row in self.rows],
            "cheapest": [
                {
                    "program": program,
                    "psnr_db": target,
                    "row": None if (row := self.cheapest(program, target)) is None else self._row(row),
                }
                for program in self.programs()
                for target in TARGETS_DB
            ],
        }

    def _row(self, row):
        return {
            "program": row.program,
            "setting": row.setting,
            "processor_ms": row.processor_ms,
            "wall_ms": row.wall_ms,
            "ratio": self.ratio(row),
            "plain_ratio": self.ratio(row, self.plain),
            "wall_ratio": self.wall_ratio(row),
            "psnr_db": row.psnr_db if math.isfinite(row.psnr_db) else None,
        }

    def text(self):
        """Two tables, and what they say of what."""
        facts = self.facts
        clock = "processor" if self.by_processor else "wall"
        width, height = facts["size"]
        device = f"{facts['ashfall_device']} ({facts['ashfall_driver']})"
        lines = [
            f'{facts["scene"]}, view "{facts["view"]}", {width} x {height}, voxels {facts["voxels"]}',
            f"VTK {facts['vtk']}, {facts['vtk_window']}: {facts['vtk_driver']}",
            f"{facts['ashfall']}, early stop {facts['ashfall_early_stop']:g}: {device}",
            f"medians of {facts['repeats']}, ratios of {clock} time; over VTK: over {self.base.program}, {self.base.setting};",
            f"over plain: over {self.plain.program}, {self.plain.setting}",
            *EXPLAINED,
        ]
        if self.drift is not None:
            ratios = f"{self.drift['ratio']:.2f} ({self.drift['wall_ratio']:.2f} on the wall)"
            lines.append(f"that frame after all others over itself before them: {ratios}")
        head = ["program", "setting", "ms", "over VTK", "over plain", "wall ms", "wall over VTK", "dB"]
        body = [[row.program, row.setting, *self._times(row)] for row in self.rows]
        lines += ["", *table(head, body, left=2), ""]
        lines.append("the least that each needs to come so near to the truth:")
        head.insert(1, "within")
        body = [
            [program, f"{target} dB", *self._reaches(program, target)]
            for target in TARGETS_DB
            for program in self.programs()
        ]
        return "\n".join(lines + ["", *table(head, body, left=3)]) + "\n"

    def _reaches(self, program, target):
        row = self.cheapest(program, target)
        if row is None:
            best = max(row.psnr_db for row in self._of(program))
            return ["not reached", "-", "-", "-", "-", "-", f"{best:.1f} at best"]
        return [row.setting, *self._times(row)]

    def _times(self, row):
        return [
            "-" if row.processor_ms is None else f"{row.processor_ms:.0f}",
            f"{self.ratio(row):.3f}",
            f"{self.ratio(row, self.plain):.3f}",
            f"{row.wall_ms:.0f}",
            f"{self.wall_ratio(row):.3f}",
            f"{row.psnr_db:.1f}" if math.isfinite(row.psnr_db) else "equal",
        ]


def table(head, body, left):
    """Lines of a Markdown table whose first `left` columns are words."""
    widths = [max(len(line[column]) for line in [head, *body]) for column in range(len(head))]

    def line(cells):
        words = [cell.ljust(width) for cell, width in zip(cells[:left], widths[:left])]
        numbers = [cell.rjust(width) for cell, width in zip(cells[left:], widths[left:])]
        return "| " + " | ".join(words + numbers) + " |"

    rule = ["-" * (width + 2) if at < left else "-" * (width + 1) + ":" for at, width in enumerate(widths)]
    return [line(head), "|" + "|".join(rule) + "|", *map(line, body)]
