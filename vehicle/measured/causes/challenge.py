"""Every cause challenged once more when the model is settled, by each effect of its block and of those beside it.

An effect enters while others are missing, so the first to enter may stand in for the one that acts. When nothing more
enters, each part gives up its place in turn, and every rival is fitted there from several starts. One that explains
more, in all runs and in runs held out, takes the place; one that explains as much is told with the drive that decides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from vehicle.effects import CATALOGUE, PATH, POSITION, SPEED, STEERING, effect
from vehicle.measured.causes.dependence import Dependence
from vehicle.measured.causes.evidence import held_out_losses, nameable_parts
from vehicle.measured.causes.refit import enlarged, with_unnamed, without
from vehicle.measured.causes.traces import Traces
from vehicle.measured.causes.trial import Projector, Tried, needed, tried
from vehicle.measured.fit.fitting import Fit, refined
from vehicle.measured.fit.knobs import Knobs, finest_of, knobs_for
from vehicle.measured.fit.products import side_by_side, squared
from vehicle.measured.logs.record import Array
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import (
    FORESEEN,
    LEAST_GAIN,
    LEAST_WITHIN_RUNS,
    LOOK_ALIKE,
    LOOK_ALIKE_SHARE,
    REFITTED,
)
from vehicle.tractor import Tractor

Alike = Mapping[str, dict[str, float]]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a challenge came to: the fit that is better, if any, or by name the rivals as good and their values."""

    better: Fit | None = None
    unnamed: tuple[Dependence, ...] = ()
    alike: Mapping[str, Alike] = field(default_factory=dict)


def beside(bench: Bench, block: str) -> frozenset[str]:
    """The blocks whose effects could stand in for one of a block: sensors cut the chain, what lies between does not."""
    joined = {PATH, POSITION}
    joined |= set() if bench.has_wheel else {STEERING}
    joined |= set() if bench.has_speed else {SPEED}
    return frozenset(joined) if block in joined else frozenset({block})


def challenged(bench: Bench, fit: Fit, unnamed: tuple[Dependence, ...], tractor: Tractor) -> Outcome:
    """Challenge every part that may carry a name, and the unnamed terms."""
    if unnamed:
        plain = _without_terms(bench, fit, tractor)
        if plain is not None:
            return Outcome(plain)
    alike: dict[str, Alike] = {}
    names = nameable_parts(bench, fit, tractor)
    # For one part alone the traces would cost as much as the trials they spare.
    traces = Traces(bench.changes, fit, bench.surprise(fit.settings)) if len(names) > 1 else None
    for name in names:
        better, alike[name] = _rivals(bench, fit, name, traces)
        if better is not None:
            return Outcome(better, unnamed)
    return Outcome(alike=alike)


def _rivals(bench: Bench, fit: Fit, name: str, traces: Traces | None) -> tuple[Fit | None, Alike]:
    """The fit in which a rival is clearly better in the place of an effect, if any; and those that are as good."""
    tractor = bench.rig.tractor
    rest = without(bench, fit, name)
    gain = rest.loss - fit.loss
    slack = LOOK_ALIKE + LOOK_ALIKE_SHARE * gain
    held_out = float(held_out_losses(bench, fit).sum())
    better, alike = fit, {}
    for other in _in_place(bench, rest, (*fit.settings,), effect(name).block, gain - slack, traces)[:REFITTED]:
        if other.gain < gain - slack or other.knobs.deviation(other.at) <= finest_of(tractor, other.knobs.id):
            continue
        full = refined(bench, enlarged(bench, rest, other))
        worse = float(held_out_losses(bench, full).sum()) - held_out
        if full.loss < better.loss - LEAST_GAIN and worse < 0.0:
            better = full
        elif full.loss < fit.loss + slack and worse < slack:
            alike[other.knobs.id] = full.settings[other.knobs.id]
    return (None, alike) if better is fit else (better, {})


def _in_place(
    bench: Bench, rest: Fit, skip: Iterable[str], block: str, worth: float, traces: Traces | None = None
) -> list[Tried]:
    """Every effect beside a block on top of what is left, each from several starts, the best first.

    Those that promise far less than the gain that is `worth` something are only begun, and by their `traces` left out.
    """
    project = Projector(rest.slope)
    left, every = project(rest.surprise), _rivals_beside(bench, skip, block)
    some = every if traces is None else [one for one in every if not traces.hopeless(left, project, one, worth)]
    return sorted((tried(bench.changes, rest, one, project, worth, left) for one in some), key=lambda one: -one.gain)


def _rivals_beside(bench: Bench, skip: Iterable[str], block: str) -> list[Knobs]:
    """Every effect beside a block that was not searched for, each with several starts."""
    blocks, taken = beside(bench, block), frozenset(skip)
    return [
        with_more_starts(knobs_for(bench.rig.tractor, entry.id, bench.course.places))
        for entry in CATALOGUE
        if entry.block in blocks and entry.id not in taken and not entry.kind.searched
    ]


def with_more_starts(knobs: Knobs) -> Knobs:
    """The same with a usual size to either side among its starts, as far as a tractor can have it."""
    if knobs.count > 1:
        return knobs
    usual = np.array(knobs.typical)
    sides = [(float(at),) for side in (usual, -usual) for at in knobs.inside(np.array(knobs.neutral) + side)]
    return replace(knobs, starts=tuple(dict.fromkeys((*knobs.starts, *sides))))


def _without_terms(bench: Bench, fit: Fit, tractor: Tractor) -> Fit | None:
    """A fit of effects alone that leaves no more than this one does with its unnamed terms, if one effect makes it so.

    The effect comes in the place of one that may carry a name, or beside them all.
    """
    plain = with_unnamed(bench, fit, ())
    names = nameable_parts(bench, plain, tractor)
    traces = Traces(bench.changes, plain, bench.surprise(plain.settings)) if names else None
    best: Fit | None = None

    def worth_of(loss: float) -> float:
        return (1.0 - LOOK_ALIKE_SHARE) * (loss - fit.loss) - LEAST_GAIN

    for name in (None, *names):
        if traces and name and not _may_give_way(bench, plain, name, worth_of, traces):
            continue
        rest = plain if name is None else without(bench, plain, name)
        worth = worth_of(rest.loss)
        block = PATH if name is None else effect(name).block
        for other in _in_place(bench, rest, (*plain.settings,), block, worth, traces)[:2]:
            if other.gain < worth:
                continue
            full = refined(bench, enlarged(bench, rest, other))
            if full.loss < fit.loss + LEAST_GAIN and (best is None or full.loss < best.loss):
                best = full
    return best


def _may_give_way(
    bench: Bench, fit: Fit, name: str, worth_of: Callable[[float], float], traces: Traces
) -> bool:
    """Whether a rival may promise enough in the place of a part for the others to be fitted again without it.

    Told by straight lines where the others stand; `worth_of` is what a gain must be for the loss that is left.
    """
    if (bench, name) in fit.smaller:
        return True
    project = Projector(np.delete(fit.slope, fit.columns(name), axis=1))
    alone = {other: values for other, values in fit.settings.items() if other != name}
    left = project(bench.surprise(alone))  # which takes out what is linear as well
    least = FORESEEN * needed(worth_of(squared(left)))
    rivals = _rivals_beside(bench, fit.settings, effect(name).block)
    return any(traces.promise(left, project, one) >= least for one in rivals)


def stands_alone(bench: Bench, fit: Fit, name: str) -> bool:
    """Whether a part is beyond its tolerance, to the same side, without each other part of the same make-up.

    How a valve moves wheels, and how tyres come to slide, differs from make to make in more than the effects say. Two
    effects that undo each other may make up for that, and then neither is a fault.
    """
    knobs, at = next(part for part in fit.parts if part[0].id == name)
    neutral, finest = np.array(knobs.neutral), finest_of(bench.rig.tractor, name, bench.row_s)
    for other in fit.settings:
        if other == name or make_up(other) is None or make_up(other) != make_up(name):
            continue
        there = next(place for one, place in without(bench, fit, other).parts if one.id == name)
        if float((there - neutral) @ (at - neutral)) <= 0.0 or knobs.deviation(there) <= finest:
            return False
    return True


def shows_within_runs(bench: Bench, fit: Fit, name: str) -> bool:
    """Whether an effect at a place shows where runs come to it and leave it, not only in that runs differ.

    Logs of two tractors, or of two days, bend differently from end to end: a circle round where some of them turned
    tells that as well. It must tell most of what it does beside a gain of the steering that every run has for itself.
    """
    if not effect(name).kind.searched:
        return True
    knobs, at = next(part for part in fit.parts if part[0].id == name)
    mine = fit.columns(name)
    told, others = fit.slope[:, mine] @ (at - np.array(knobs.neutral)), np.delete(fit.slope, mine, axis=1)
    turned = _turned_more(bench, fit)
    runs = [np.where(bench.runs == run, turned, 0.0) for run in range(len(bench.course.names))]
    beside = side_by_side([*others.T, *[one for one in runs if one.any()]], len(others))
    alone, within = Projector(others)(told), Projector(beside)(told)
    return float(within @ within) > LEAST_WITHIN_RUNS * float(alone @ alone)


def _turned_more(bench: Bench, fit: Fit) -> Array:
    """Change of the surprises where all runs bend a little more."""
    name = "steering_gain"
    knobs, settings = knobs_for(bench.rig.tractor, name), fit.settings
    now = settings.get(name, knobs.values(np.array(knobs.neutral)))
    more = {key: value + knobs.typical[0] for key, value in now.items()}
    base = bench.surprise(settings)
    return bench.change({**settings, name: more}, base, frozenset({PATH})) - base


def make_up(name: str) -> str | None:
    """What an effect belongs to that is shaped otherwise in every make: the steering, and the tyres on their ground."""
    entry = effect(name)
    if entry.block == STEERING:
        return STEERING
    return PATH if entry.block == PATH and entry.of_ground else None
