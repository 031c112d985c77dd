"""Hiding effects in logs of the independent truth model, and judging what a diagnosis makes of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from tests.truth.drives import Drive, default_programme
from tests.truth.effects import NEUTRAL, PLACES, scaled
from tests.truth.model import make_logs
from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.diagnosis.results import EQUIVALENT, LIKELY, NOT_VISIBLE, Diagnosis
from vehicle.identification.logs.reader import build_log
from vehicle.model.tractor import Tractor, load_tractor

BRIEF = ("straight_090", "straight_270", "circles_right", "circles_left", "steps", "speed_steps", "implement_straight")
FLOOR_SLACK = 1.10


@lru_cache(maxsize=1)
def eg105() -> Tractor:
    """The nominal tractor."""
    return load_tractor("eg105")


def brief_programme(*more: str) -> list[Drive]:
    """Seven runs of the default programme and those named."""
    return [drive for drive in default_programme() if drive.name in (*BRIEF, *more)]


def hidden(names: Sequence[str], size: float = 1.0) -> dict[str, dict[str, float]]:
    """Effects at a share of their clear sizes."""
    return {name: scaled(name, size) for name in names}


def diagnosed(
    effects: dict[str, dict[str, float]], seed: int, programme: Sequence[Drive] | None = None, **conditions: Any
) -> Diagnosis:
    """The diagnosis of logs in which the truth model hid effects."""
    frames = make_logs(effects, seed, programme, **conditions)
    return diagnose_logs([build_log(frame, frame.attrs["name"]) for frame in frames], eg105(), "soil")


@dataclass(frozen=True)
class Verdict:
    """How a diagnosis stands to what was hidden; `close` is None where nothing was found that could be."""

    found: bool
    announced: bool
    wrong: tuple[str, ...]
    close: bool | None
    at_floor: bool
    text: str


def judge(found: Diagnosis, effects: dict[str, dict[str, float]]) -> Verdict:
    """How a diagnosis stands to what was hidden.

    Found: every hidden effect is named or in a set. Announced: each one that is not is `not-visible` or `likely`, never
    refuted.
    Wrong: named and not hidden. Close: what was found is within 15 % of the truth, or the truth in its interval.
    """
    in_sets = {one.id for one in found.findings if one.status == EQUIVALENT}
    wrong = tuple(name for name in found.named if name not in effects)
    if in_sets and not in_sets & set(effects):
        wrong = (*wrong, *sorted(in_sets))
    by_id = {one.id: one for one in found.findings}
    told = [name for name in effects if name in by_id and (name in found.named or name in in_sets)]
    close = all(_close(by_id[name], name, effects[name]) for name in told) if told else None
    missed = [name for name in effects if name in by_id and name not in told]
    announced = all(by_id[name].status in (NOT_VISIBLE, LIKELY) for name in missed)
    text = f"named {list(found.named)} sets {sorted(in_sets)} unexplained {found.unexplained_share:.2f}"
    return Verdict(not missed, announced, wrong, close, at_floor(found), text)


def _close(one: Any, name: str, truth: dict[str, float]) -> bool:
    size = next(key for key in truth if key not in PLACES)
    neutral = NEUTRAL[name][size]
    reach = abs(truth[size] - neutral) if neutral != float("inf") else truth[size]
    near = abs(one.value[size] - truth[size]) <= 0.15 * reach
    low, high = (one.interval or {}).get(size, (1.0, 0.0))
    return bool(near or low <= truth[size] <= high)


def at_floor(found: Diagnosis, horizon: float = 5.0) -> bool:
    """Whether the held-out error is within a tenth of the noise floor, of every kind."""
    after, floor = found.after[horizon], found.noise_floor[horizon]
    kinds = ("cross_cm", "along_cm", "heading_deg")
    return all(getattr(after, kind) <= FLOOR_SLACK * getattr(floor, kind) for kind in kinds)
