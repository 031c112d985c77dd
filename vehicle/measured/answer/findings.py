"""One finding per effect of the catalogue: status, value, gain, and the smallest size the logs would have shown."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from vehicle.effects import CATALOGUE, STEERING, Effect, effect, neutral
from vehicle.kinds import Interval
from vehicle.measured.answer.verdict import EQUIVALENT, NAMED, NOT_VISIBLE, REFUTED, Finding, finite
from vehicle.measured.causes.refit import without
from vehicle.measured.causes.trial import Projector, tried
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.fit.knobs import Knobs, finest_of, knobs_for, settings_of
from vehicle.measured.fit.openloop import Term
from vehicle.measured.logs.record import Array
from vehicle.measured.mend.extension import Extension, driven_seconds, main_terms
from vehicle.measured.replay.horizons import Halves, Squares, chain, run_squares, total_error
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import LEAST_GAIN, LOOK_ALIKE, LOOK_ALIKE_SHARE, SURELY_SHOWN
from vehicle.tractor import Tractor

DRAWS = 400  # resampled sets of runs: chosen, leaves an interval steady to its last digit printed
TRIAL_SHARES = (0.3, 1.0, 2.0)
Rivals = Mapping[str, Mapping[str, dict[str, float]]]


@dataclass(frozen=True, eq=False)
class Case:
    """What findings are drawn from: the fit to the surprises, what is added to the tractor, and the noise floor."""

    bench: Bench
    fit: Fit
    extension: Extension
    floor: list[Squares]

    @property
    def tractor(self) -> Tractor:
        """The tractor without effects."""
        return self.bench.rig.tractor

    @cached_property
    def misfit(self) -> float:
        """Squared error that is left, in units of the noise floor, at least 1: it hides small effects."""
        return max(1.0, float(self.final.sum()) / float(self.number(self.floor).sum()))

    def number(self, squares: list[Squares]) -> Array:
        """Squared errors of every run as one number each, in units of the noise floor."""
        seen = all(stretch.speed_seen for stretch in self.bench.course.stretches)
        return total_error(squares, self.floor, along=seen)

    def error(self, settings: Mapping[int, Halves]) -> Array:
        """Error of every run as one number."""
        return self.number(run_squares(self.bench.course, self.bench.rig, settings))

    def gain_of(self, name: str) -> tuple[float, tuple[float, float]]:
        """Percent of the held-out error over 5 s that an effect takes away, with a 90 % interval over runs."""
        return gain_between(self.error(self.extension.without(name)), self.final)

    @cached_property
    def final(self) -> Array:
        """Error of every run with all that was found."""
        return self.error(self.extension.held_out)

    def worth_of(self, name: str) -> float:
        """Percent of the error where the effect shows: of the wheel angle for the steering, else of the path."""
        if effect(name).block == STEERING and self.bench.has_wheel:
            settings = self.extension.without(name), self.extension.held_out
            return gain_between(*(_wheel_squares(self.bench, one) for one in settings))[0]
        return self.gain_of(name)[0]


def _wheel_squares(bench: Bench, settings: Mapping[int, Halves]) -> Array:
    """Squared error of the simulated wheel angle, per run."""
    found = np.zeros(len(bench.course.names))
    for stretch in bench.course.stretches:
        wheel = chain(bench.rig, stretch, settings[stretch.run][0])[2]
        if stretch.wheel is not None:
            found[stretch.run] += float(np.sum((stretch.wheel - wheel) ** 2))
    return found


def gain_between(worse: Array, final: Array) -> tuple[float, tuple[float, float]]:
    """Percent of the root mean square that is gone, with a 90 % interval over runs."""
    rng = np.random.default_rng(11)
    drawn = rng.integers(0, len(worse), size=(DRAWS, len(worse)))
    shares = 100.0 * (1.0 - np.sqrt(final[drawn].sum(axis=1) / np.maximum(worse[drawn].sum(axis=1), 1e-12)))
    whole = 100.0 * (1.0 - math.sqrt(float(final.sum()) / max(float(worse.sum()), 1e-12)))
    return whole, (float(np.quantile(shares, 0.05)), float(np.quantile(shares, 0.95)))


def look_alikes(bench: Bench, fit: Fit, name: str) -> dict[str, dict[str, float]]:
    """Effects that explain as much in the place of a named one, with the values they would need."""
    tractor = bench.rig.tractor
    rest = without(bench, fit, name)
    project = Projector(rest.slope)
    gain = rest.loss - fit.loss
    found = {}
    for entry in CATALOGUE:
        if entry.id in fit.settings or entry.kind.searched:
            continue
        knobs = knobs_for(tractor, entry.id)
        other = tried(bench.change, rest, knobs, project)
        far = knobs.deviation(other.at)
        if other.gain > gain - LOOK_ALIKE - LOOK_ALIKE_SHARE * gain and far > finest_of(tractor, entry.id):
            found[entry.id] = knobs.values(other.at)
    return found


def findings(case: Case, names: Sequence[str], rivals: Rivals, step: Callable[[], None]) -> list[Finding]:
    """A finding for every effect; `rivals` are the look-alikes of the names."""
    alike = {other: name for name, others in rivals.items() for other in others}
    found = []
    for entry in CATALOGUE:
        step()
        if entry.id in names:
            found.append(_in_model(case, entry, EQUIVALENT if rivals.get(entry.id) else NAMED, rivals))
        elif entry.id in case.extension.ids:
            found.append(_in_model(case, entry, NOT_VISIBLE, {}))
        elif entry.id in alike:
            found.append(_stand_in(case, entry, alike[entry.id], rivals))
        else:
            found.append(_absent(case, entry))
    return found


def _term(case: Case, name: str) -> Term:
    main = main_terms(case.extension.terms, driven_seconds(case.bench))
    return next(term for term in main if term.knobs.id == name)


def _in_model(case: Case, entry: Effect, status: str, rivals: Rivals) -> Finding:
    gain, interval = case.gain_of(entry.id)
    value = _term(case, entry.id).knobs.values(_term(case, entry.id).at)
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
    of = _term(case, name).knobs.values(_term(case, name).at)
    return Finding(
        entry.id, EQUIVALENT, value, None, None, None, visible(case, entry), entry.size.unit, entry.block,
        entry.words(value), same, f"looks like {sized(effect(name), of)} of {name}",
    )  # fmt: skip


def _absent(case: Case, entry: Effect) -> Finding:
    """An effect that is not in the model: refuted when its usual size would have shown."""
    smallest = visible(case, entry)
    typical = entry.size.for_wheelbase(case.tractor.wheelbase_m).typical
    finer = smallest is not None and entry.kind.as_fine(smallest, typical)
    # What the surprises speak for is not refuted, though it does not lower the error.
    status = REFUTED if finer and not _spoken_for(case, entry) else NOT_VISIBLE
    return Finding(entry.id, status, None, None, None, None, smallest, entry.size.unit, entry.block, "")


def _spoken_for(case: Case, entry: Effect) -> bool:
    """Whether the fit to the surprises has the effect, beyond its tolerance."""
    tractor, row_s = case.tractor, case.bench.row_s
    sizes = [knobs.deviation(at) for knobs, at in case.fit.parts if knobs.id == entry.id]
    return any(size > finest_of(tractor, entry.id, row_s) for size in sizes)


def visible(case: Case, entry: Effect) -> float | None:
    """Smallest size, in the unit of the effect, whose trace would rise above chance, tolerance and what is left."""
    bench, fit, tractor = case.bench, case.fit, case.tractor
    settings = {k: v for k, v in fit.settings.items() if k != entry.id}
    parts = [part for part in fit.parts if part[0].id != entry.id]
    bare = bench.surprise(settings)
    project = Projector(fit.slope[:, _others(fit, entry.id)])
    knobs = knobs_for(tractor, entry.id, _middle(bench))
    for share in TRIAL_SHARES:
        at = knobs.inside(np.array(knobs.neutral) + share * np.array(knobs.typical))
        trace = project(bench.change(settings_of([*parts, (knobs, at)]), bare, frozenset({entry.block})) - bare)
        strength = float(trace @ trace)
        if strength > SURELY_SHOWN * LEAST_GAIN * case.misfit:
            return _size(tractor, knobs, at, share, strength / case.misfit)
    return None


def _size(tractor: Tractor, knobs: Knobs, at: Array, share: float, strength: float) -> float | None:
    """Size at which a trace, growing with the square of the size, would just show."""
    enough = share * math.sqrt(SURELY_SHOWN * LEAST_GAIN / strength)
    return finite(effect(knobs.id).kind.smallest(at, enough, knobs.typical[0], finest_of(tractor, knobs.id)))


def _others(fit: Fit, name: str) -> npt.NDArray[np.int64]:
    keep = np.ones(fit.slope.shape[1], dtype=np.bool_)
    if name in fit.settings:
        keep[fit.columns(name)] = False
    return np.flatnonzero(keep)


def _middle(bench: Bench) -> tuple[float, float, float]:
    """A circle about the middle of the driving, a quarter of its spread wide."""
    east = np.concatenate([one.east for one in bench.course.stretches])
    north = np.concatenate([one.north for one in bench.course.stretches])
    radius = 0.25 * float(max(np.ptp(east), np.ptp(north)))
    origin = bench.course.origin
    return float(np.median(east)) + origin[0], float(np.median(north)) + origin[1], radius
