"""The error that noise alone leaves: what a true model would still get wrong in these logs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vehicle.layout import DT_S
from vehicle.learnt import Settings
from vehicle.measured.replay.course import Stretch
from vehicle.measured.replay.horizons import Seen, Squares, chain, no_squares, squares
from vehicle.measured.replay.replaying import replay
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.surprise.draws import coloured, noisy_instruments, over_rough_ground


def floor_squares(
    bench: Bench, settings: Mapping[int, Settings], seed: int = 7, tolerated: Settings | None = None
) -> list[Squares]:
    """Sums of squares that noise alone leaves: a replay of the model with the scatter seen in these logs.

    Wheel angle and speed scatter as they do while nothing changes, and as commands are off in time; the ground and the
    instruments have noise of the strength told from quick changes. What the model itself gets wrong has no part in it,
    but for what is `tolerated`: effects of the speed within the tolerance of the file, by which drive lines differ.
    """
    rng = np.random.default_rng(seed)
    totals = no_squares(len(bench.course.names))
    for index, stretch in enumerate(bench.course.stretches):
        mine = settings[stretch.run]
        plain = chain(bench.rig, stretch, mine)
        driven = chain(bench.rig, stretch, {**(tolerated or {}), **mine}) if tolerated else plain
        noisy = _noisy(bench, index, driven, mine, rng)
        for horizon, part in squares(noisy, plain[0], plain[1]).items():
            totals[stretch.run][horizon] += part
    return totals


def _noisy(bench: Bench, index: int, driven: Seen, settings: Settings, rng: np.random.Generator) -> Stretch:
    """The stretch as it might have been measured had the model been true."""
    stretch = bench.course.stretches[index]
    grid = np.arange(len(stretch.grids["speed"])) * DT_S
    grids = dict(stretch.grids)
    for name, simulated, channel in (
        ("wheel", driven[2], bench.wheel[index]), ("speed", driven[3], bench.speed[index])
    ):  # fmt: skip
        off = np.zeros(stretch.rows)
        if channel is not None:
            off = channel.scatter * coloured(rng, np.full(stretch.rows, channel.memory))
        grids[name] = np.interp(grid, stretch.time, simulated + off)
    drawn = replace(stretch, grids=grids, wheel=driven[2])
    states = over_rough_ground(bench.noise, replay(bench.rig, drawn, settings, True, True), rng)
    return noisy_instruments(bench.rig, bench.noise, stretch, states, settings, rng)[0]
