"""What only a heading tells apart: an antenna further back than the file says, and positions or steering that are late.

Each of them has the positions turn later than the commands. Where no heading was logged, directions are told from the
path of the antenna as far ahead as the file has it, which parts them by less than their values are off.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from vehicle.measured.replay.drives import usual
from vehicle.measured.surprise.bench import Bench

LATE = ("antenna_forward", "gnss_latency", "steering_dead_time")
Values = dict[str, float]


def kin(bench: Bench) -> tuple[str, ...]:
    """Effects that these logs cannot tell apart for want of a heading, and of a wheel angle for the last of them."""
    if all(one.heading_seen for one in bench.course.stretches):
        return ()
    return LATE[:2] if bench.has_wheel else LATE


def with_kin(
    bench: Bench, rivals: Mapping[str, Mapping[str, Values]], found: Mapping[str, Values], taken: Collection[str]
) -> dict[str, dict[str, Values]]:
    """The rivals of names, with those of `kin` at the values that would be as late as what was `found`.

    What is `taken` is in the model itself and no rival.
    """
    _, pace = usual(bench.course.stretches)
    same, out = kin(bench), {name: dict(others) for name, others in rivals.items()}
    for name in out:
        late_m = _late_m(name, found[name], pace) if name in same else 0.0
        if late_m > 0.0:
            others = {other: _as_late(other, late_m, pace) for other in same if other != name and other not in taken}
            out[name] = {**others, **out[name]}
    return out


def _late_m(name: str, values: Values, pace: float) -> float:
    """How far (m) behind its place on the way an effect has the positions."""
    return -values["distance_m"] if name == "antenna_forward" else values["time_s"] * pace


def _as_late(name: str, late_m: float, pace: float) -> Values:
    return {"distance_m": -late_m} if name == "antenna_forward" else {"time_s": late_m / pace}
