"""The sample log that comes with the program: the truth with one hidden effect, driven once.

python -m tests.truth.sample_log vehicle/data/sample_log.csv
"""

import sys
from pathlib import Path

from tests.truth.drives import Drive, drive, stairs
from tests.truth.model import Truth

HIDDEN = {"understeer": {"deg_per_mps2": 2.0}}
ANGLES = (
    (16, 0), (14, 6), (14, -6), (16, 14), (16, -14), (10, 0), (12, 20), (12, -20), (8, 3), (8, -3), (6, 8), (6, -8),
    (6, 15), (6, -15), (16, 10), (16, -10), (14, 0),
)  # fmt: skip
SPEEDS = (
    (16, 1.4), (28, 2.4), (8, 1.2), (8, 2.2), (8, 1.2), (8, 2.2), (10, 1.4), (24, 1.0), (28, 1.4), (12, 1.8), (8, 0.9),
    (8, 2.6), (8, 0.9), (8, 2.6), (14, 1.4),
)  # fmt: skip
TRUTH = Truth(HIDDEN, seed=7, rate_hz=10.0, origin=(500_000.0, 4_770_000.0), drop=("implement",))


def build_sample_drive() -> Drive:
    """A bit more than three minutes: bends to both sides, slowly and fast."""
    seconds = float(sum(held for held, _ in ANGLES))
    return drive("sample", seconds, stairs(*ANGLES), stairs(*SPEEDS), bearing_deg=60.0)


def format_sample_log() -> str:
    """The log as CSV."""
    return str(TRUTH.log(build_sample_drive()).to_csv(index=False, float_format="%.3f", lineterminator="\n"))


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(format_sample_log(), encoding="utf-8")
