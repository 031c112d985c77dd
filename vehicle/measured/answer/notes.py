"""Sentences beside a diagnosis: what the reader should know of the rows and columns, and of the tractor file."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vehicle.measured.answer.verdict import Diagnosis
from vehicle.measured.logs.record import Log
from vehicle.measured.logs.remarks import remarks_of
from vehicle.measured.logs.sensors import CLOCKS_FROM_S
from vehicle.measured.surprise.bench import Bench
from vehicle.tractor import Tractor

TIMES = ("steering_dead_time", "gnss_latency")  # what two clocks that part would be taken for
ON_OWN_GROUND = (
    "The figures after are for every run on its own ground, told from the other half of the run; the tractor file has "
    "one ground and does worse on the other."
)


def notes(logs: Sequence[Log], bench: Bench, tractor: Tractor, answer: Diagnosis) -> tuple[str, ...]:
    """All sentences, those of the logs first."""
    told = (*_of_logs(logs, bench), *_of_part(bench, answer), *_of_clocks(logs, answer), *_of_file(tractor, answer))
    return (*told, ON_OWN_GROUND) if answer.grounds else told


def _of_logs(logs: Sequence[Log], bench: Bench) -> tuple[str, ...]:
    """What the reader should know about the rows and columns."""
    told = remarks_of(logs) + list(bench.course.remarks)
    if not bench.has_wheel:
        told.append(
            "No wheel angle was logged: faults of the steering system and of the path cannot be told apart well."
        )
    if any(one.target is None for one in bench.course.stretches):
        told.append("No commanded speed was logged: the speed block was not looked at.")
    if any(log.heading_deg is None for log in logs):  # of all logs, as errors are: a part may lack some of them
        told.append("No heading was logged: the course of the positions stands in for it.")
    if len(logs) == 1:
        told.append("One run only: its own 20 s windows stand in for runs not used for fitting.")
    return tuple(told)


def _of_part(bench: Bench, answer: Diagnosis) -> tuple[str, ...]:
    """That causes of long logs were sought in a part of them."""
    minutes = bench.course.seconds / 60.0
    if minutes >= answer.minutes:
        return ()
    return (
        f"Causes, values and intervals are told from {minutes:.0f} of {answer.minutes:.0f} minutes, pieces from all "
        "over the logs; the errors before and after, and what is left unexplained, are of all of them.",
    )


def _of_clocks(logs: Sequence[Log], answer: Diagnosis) -> list[str]:
    """Where a time was found, that logs too short for it were not asked whether two clocks part."""
    late = [one.id for one in answer.findings if one.id in TIMES and one.value is not None]
    short = sum(float(np.ptp(log.time_s[log.used])) < CLOCKS_FROM_S for log in logs)
    if not late or not short:
        return []
    which = "The log is" if len(logs) == 1 else f"{short} of {len(logs)} logs are"
    return [
        f"{which} too short (under {CLOCKS_FROM_S:.0f} s) to tell whether the clocks of two sources part: what is said "
        f"of {' and '.join(late)} takes one clock for granted."
    ]


def _of_file(tractor: Tractor, answer: Diagnosis) -> tuple[str, ...]:
    """What became of the effects and the rest that the tractor file had."""
    told = []
    if tractor.effects:
        unseen = [name for name, one in tractor.effects.items() if answer.tractor.effects.get(name) is one]
        kept = f" These logs do not show {', '.join(unseen)}: kept as the file has it." if unseen else ""
        told.append(
            f"The tractor file has {', '.join(tractor.effects)} already: set aside and fitted anew; the error before "
            f"is that of the file.{kept}"
        )
    if tractor.rest is not None:
        kept = "kept, these logs do not speak against it" if answer.tractor.rest is tractor.rest else "replaced"
        kept = "dropped, these logs speak against it" if answer.tractor.rest is None else kept
        told.append(f"The tractor file has a rest: {kept}.")
    return tuple(told)
