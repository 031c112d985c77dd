"""The cheapest drive that would tell apart causes that look alike in the logs at hand.

A small library of drives a person can make is simulated with each rival at the value it needs to explain the logs; the
drive counts as decisive when the other rival, free to change its value, stays clearly wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vehicle.measured.answer.verdict import NextDrive
from vehicle.measured.causes.trial import Projector, tried
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.fit.knobs import Knobs, knobs_for
from vehicle.measured.replay.drives import DRILLS, Drill, driven, usual
from vehicle.measured.surprise.bench import Bench, prepare
from vehicle.measured.surprise.weights import Channel
from vehicle.measured.thresholds import DECISIVE
from vehicle.tractor import Tractor

Values = Mapping[str, dict[str, float]]


def next_drive(
    bench: Bench, fit: Fit, tractor: Tractor, rivals: Mapping[str, Values], found: Values
) -> NextDrive | None:
    """The shortest decisive drive for the first set of rivals; the most telling one when none decides.

    `found` are the values of names, of which the fit may lack some.
    """
    for name, others in rivals.items():
        for other, values in others.items():
            beside = {known: mine for known, mine in fit.settings.items() if known != name}
            both = ({name: found[name], **fit.settings}, {**beside, other: values})
            scored = [(drill, _score(bench, drill, tractor, both, (name, other))) for drill in DRILLS]
            good = [one for one in scored if one[1] > DECISIVE]
            drill, score = min(good, key=lambda o: o[0].seconds) if good else max(scored, key=lambda o: o[1])
            return NextDrive(drill.id, drill.words, drill.seconds, (name, other), score, score > DECISIVE)
    return None


def _score(bench: Bench, drill: Drill, tractor: Tractor, both: tuple[Values, Values], names: tuple[str, str]) -> float:
    """What separates the rivals: the smaller of the two losses of explaining one's drive by the other."""
    heading, pace = usual(bench.course.stretches)
    losses = []
    for true, wrong, name in ((both[0], both[1], names[1]), (both[1], both[0], names[0])):
        made = driven(bench.rig, drill, heading, pace, true)
        trial = prepare(made, replace(bench.rig, origin=(0.0, 0.0)), true, bench.noise)
        trial = replace(trial, wheel=_steady(bench.wheel, trial), speed=_steady(bench.speed, trial))
        losses.append(_misfit(trial, tractor, wrong, name))
    return min(losses)


def _steady(channels: tuple[Channel | None, ...], trial: Bench) -> tuple[Channel | None, ...]:
    """Weights of the logs' own channels, as even numbers per row."""
    known = [one for one in channels if one is not None]
    if not known:
        return tuple(None for _ in trial.course.stretches)
    level = float(np.median(np.concatenate([one.sigma for one in known])))
    rows = [np.full(stretch.rows, level) for stretch in trial.course.stretches]
    return tuple(Channel(one, known[0].memory, one) for one in rows)


def _misfit(trial: Bench, tractor: Tractor, wrong: Values, name: str) -> float:
    """Loss left when the rival may choose its value again."""
    knobs: Knobs = knobs_for(tractor, name)
    rest = {k: v for k, v in wrong.items() if k != name}
    surprise = trial.surprise(rest)
    fixed = Fit((), surprise, np.zeros((len(surprise), 0)))
    return fixed.loss - tried(trial.on_top_of(rest).changes, fixed, knobs, Projector(fixed.slope)).gain
