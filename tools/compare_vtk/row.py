"""One line of the comparison."""

from dataclasses import dataclass


@dataclass
class Row:
    """A program with a setting: medians in milliseconds, and the picture's PSNR over linear rgb."""

    program: str
    setting: str
    # Of the process; None where drawing is not the processor's work.
    processor_ms: float | None
    wall_ms: float
    psnr_db: float
