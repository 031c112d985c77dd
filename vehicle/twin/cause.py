"""From the recorded log of a twin to what the real tractor does otherwise, and to the amended tractor.

The work is that of `headland diagnose`, on the log that the link left. It takes seconds to minutes: run it beside the
twin, not in its loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from vehicle.measured.answer.diagnose import Progress, diagnose
from vehicle.measured.answer.save import tractor_toml
from vehicle.measured.answer.verdict import NAMED, Diagnosis
from vehicle.measured.logs.record import Log
from vehicle.tractor import Tractor


@dataclass(frozen=True, eq=False)
class Cause:
    """What a diagnosis says of recorded logs: whether an effect has a name, the verdict in words, the tractor with what
    was found and its file, and the whole diagnosis."""

    named: tuple[str, ...]
    words: str
    tractor: Tractor
    toml: str
    diagnosis: Diagnosis


def explain(
    logs: Sequence[Log], tractor: Tractor, ground: str = "soil", progress: Progress | None = None
) -> Cause:  # fmt: skip
    """Diagnose recorded logs (`twin.recording.log(name)`) of one tractor, driven on one ground.

    `progress` is called with (done, an estimate of all). The amended tractor is for saving: its file carries what was
    named, and what only lowers the error as a calibration. Raises LogError for logs without 5 s of forward driving, and
    VehicleError for an unknown ground.
    """
    found = diagnose(logs, tractor, ground, progress)
    named = tuple(one.id for one in found.findings if one.status == NAMED)
    return Cause(named, found.headline, found.tractor, tractor_toml(found.tractor), found)
