"""One finding per effect of the catalogue: status, value, gain, and the smallest size the logs would have shown."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from vehicle.effects import CATALOGUE, Effect, effect, neutral
from vehicle.kinds import Interval
from vehicle.measured.answer.case import Case
from vehicle.measured.answer.late import kin
from vehicle.measured.answer.verdict import EQUIVALENT, LIKELY, NAMED, NOT_VISIBLE, REFUTED, Finding, finite
from vehicle.measured.causes.trial import Projector, tried
from vehicle.measured.fit.knobs import Knobs, finest_of, knobs_for, settings_of
from vehicle.measured.fit.products import squared
from vehicle.measured.logs.record import Array
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import LEAST_GAIN, SURELY_SHOWN
from vehicle.tractor import Tractor

TRIAL_SHARES = (0.3, 1.0, 2.0)  # of the typical size: a small trial is nearly linear, a large one shows a dead band
Rivals = Mapping[str, Mapping[str, dict[str, float]]]


def findings(case: Case, names: Sequence[str], rivals: Rivals, step: Callable[[], None]) -> list[Finding]:
    """A finding for every effect; `rivals` are the look-alikes of the names."""
    alike = {other: name for name, others in rivals.items() for other in others}
    told = []
    for entry in CATALOGUE:
        step()
        if entry.id in names:
            told.append(_in_model(case, entry, EQUIVALENT if rivals.get(entry.id) else NAMED, rivals))
        elif entry.id in case.extension.ids:
            told.append(_in_model(case, entry, LIKELY, {}))
        elif entry.id in alike:
            told.append(_stand_in(case, entry, alike[entry.id], rivals))
        else:
            told.append(_absent(case, entry))
    return told


def _in_model(case: Case, entry: Effect, status: str, rivals: Rivals) -> Finding:
    gain, interval = case.gain_of(entry.id)
    value = case.main_terms[entry.id].value
    others = rivals.get(entry.id, {})
    exchange = "; ".join(
        f"{sized(entry, value)} looks like {sized(effect(other), values)} of {other}"
        for other, values in others.items()
    )
    spread = dict(case.extension.intervals[entry.id])
    if status == EQUIVALENT:
        spread[entry.size.name] = with_neutral(case.tractor, entry, spread[entry.size.name])
    return Finding(
        entry.id, status, value, spread, gain, interval, visible(case, entry),
        entry.size.unit, entry.block, entry.words(value), tuple(others), exchange,
    )  # fmt: skip


def with_neutral(tractor: Tractor, entry: Effect, interval: Interval) -> Interval:
    """The interval of a cause that another one may stand for altogether: it reaches to neutral."""
    zero = neutral(entry.id, tractor.steering)[entry.size.name]
    return min(interval[0], zero), max(interval[1], zero)


def sized(entry: Effect, value: Mapping[str, float]) -> str:
    """The size of an effect with its unit."""
    return f"{value[entry.size.name]:.3g} {entry.size.unit}".strip()


def _stand_in(case: Case, entry: Effect, name: str, rivals: Rivals) -> Finding:
    """An effect that would explain as much as one in the model."""
    value = rivals[name][entry.id]
    same = (name, *[one for one in rivals[name] if one != entry.id])
    of = case.main_terms[name].value
    return Finding(
        entry.id, EQUIVALENT, value, None, None, None, visible(case, entry), entry.size.unit, entry.block,
        entry.words(value), same, f"looks like {sized(effect(name), of)} of {name}",
    )  # fmt: skip


def _absent(case: Case, entry: Effect) -> Finding:
    """An effect that is not in the model: refuted when its usual size would have shown."""
    smallest = visible(case, entry)
    typical = entry.size.for_wheelbase(case.tractor.wheelbase_m).typical
    finer = smallest is not None and entry.kind.as_fine(smallest, typical)
    # What the surprises speak for is not refuted, though it does not lower the error; nor is what lacks a heading.
    unsure = entry.id in kin(case.bench) or _spoken_for(case, entry)
    status = REFUTED if finer and not unsure else NOT_VISIBLE
    return Finding(entry.id, status, None, None, None, None, smallest, entry.size.unit, entry.block, "")


def _spoken_for(case: Case, entry: Effect) -> bool:
    """Whether the surprises speak for the effect, beyond its tolerance."""
    if entry.id in case.refused:
        return True
    tractor, row_s = case.tractor, case.bench.row_s
    sizes = [knobs.deviation(at) for knobs, at in case.fit.parts if knobs.id == entry.id]
    extra = case.fit.extra
    if not sizes and extra is not None and extra.amounts[extra.terms].size and not entry.kind.searched:
        # Terms without a name may have taken up what an effect explains: it is asked what it would take without them.
        knobs = knobs_for(tractor, entry.id, case.bench.course.places)
        one = tried(case.bench.changes, case.plain, knobs, Projector(case.plain.slope))
        sizes = [one.knobs.deviation(one.at)] if one.gain > LEAST_GAIN else []
    return any(size > finest_of(tractor, entry.id, row_s) for size in sizes)


def visible(case: Case, entry: Effect) -> float | None:
    """Smallest size, in the unit of the effect, whose trace would rise above chance, tolerance and what is left."""
    bench, fit, tractor = case.bench, case.fit, case.tractor
    parts = [part for part in fit.parts if part[0].id != entry.id]
    bare, project = case.without_one(entry.id) if entry.id in fit.settings else case.as_fitted
    places = bench.course.places
    knobs = knobs_for(tractor, entry.id, {**places, entry.id: _middle(bench)} if entry.kind.searched else places)
    for share in TRIAL_SHARES:
        at = knobs.inside(np.array(knobs.neutral) + share * np.array(knobs.typical))
        trace = project(bench.change(settings_of([*parts, (knobs, at)]), bare, frozenset({entry.block})) - bare)
        strength = squared(trace)
        if strength > SURELY_SHOWN * LEAST_GAIN * case.misfit:
            return _size(tractor, knobs, at, share, strength / case.misfit)
    return None


def _size(tractor: Tractor, knobs: Knobs, at: Array, share: float, strength: float) -> float | None:
    """Size at which a trace, growing with the square of the size, would just show."""
    enough = share * math.sqrt(SURELY_SHOWN * LEAST_GAIN / strength)
    return finite(effect(knobs.id).kind.smallest(at, enough, knobs.typical[0], finest_of(tractor, knobs.id)))


def _middle(bench: Bench) -> tuple[float, float, float]:
    """A circle about the middle of the driving, a quarter of its spread wide."""
    east = np.concatenate([one.east for one in bench.course.stretches])
    north = np.concatenate([one.north for one in bench.course.stretches])
    radius = 0.25 * float(max(np.ptp(east), np.ptp(north)))
    origin = bench.course.origin
    return float(np.median(east)) + origin[0], float(np.median(north)) + origin[1], radius
