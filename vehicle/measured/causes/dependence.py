"""What an error depends on when no effect of the catalogue explains it: unnamed terms on a list of regressors.

Each unnamed term bends the path, changes the grip, pushes the tractor over the ground or changes its speed in
proportion to a regressor. They compete with the catalogue: where one explains clearly more than any named effect,
giving a name would be wrong, and what the error depends on is said instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from vehicle.effects import PATH, SPEED, effect_fields
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.fit.products import crossed, squares
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.course import Stretch
from vehicle.measured.replay.replaying import antenna_lever
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.surprise.whitening import Increments, innovations, turn_responses

# From what a tractor can follow to longer runs; neighbours a tenth apart are as good as each other.
PERIODS_S = tuple(np.geomspace(2.5, 80.0, 36).tolist())
FEWEST_ROWS_PER_PERIOD = 8.0  # chosen: a wave of fewer cannot be told from another
LONGEST_PERIOD = 1.3  # of the longest run: chosen, a longer one is a straight line in it
MOST_TOGETHER, MOST_ROWS = 8, 200_000  # terms, and times rows: chosen, 80 MB of columns; more save no time
LEAST_CHANGE = 1e-12  # of any surprise by a column: smaller ones are rounding
DISTANCE, ALWAYS = "a change of the distance driven", "always"
Terms = list[Increments]
Products = tuple[Array, Array, Array]
Maker = Callable[[Stretch, Increments, Array], Terms]


@dataclass(frozen=True)
class Dependence:
    """An unnamed term: what it depends on, what it changes, its columns, and whether it is free in every run."""

    on: str
    changes: str
    make: Maker
    per_run: bool = False

    @property
    def words(self) -> str:
        """The term as a clause."""
        return self.changes if self.on == ALWAYS else f"{self.changes} that depends on {self.on}"

    @property
    def block(self) -> str:
        """Block of the chain that it would belong to."""
        return SPEED if self.changes == DISTANCE else PATH


def _bend(move: Increments, regressor: Array, per_angle: Array) -> Increments:
    """An extra wheel angle (rad, to the right); `per_angle` is the curvature it makes at the angle the wheels have."""
    zero = np.zeros_like(move.ahead)
    way = np.copysign(np.hypot(move.ahead, move.aside), move.ahead)  # backwards it turns the other way
    return Increments(zero, zero, -regressor * way * per_angle)


def _per_angle(bench: Bench, stretch: Stretch) -> Array:
    """Curvature per wheel angle (1/m per rad), averaged over a degree each way because the measured radii bend at 0."""
    rig, angle = bench.rig, _steering(stretch)
    grid = np.linspace(-rig.tractor.max_steering_deg, rig.tractor.max_steering_deg, len(rig.table))
    tangents = [np.tan(np.interp(np.degrees(angle) + shift, grid, rig.table)) for shift in (-1.0, 1.0)]
    slope: Array = (tangents[1] - tangents[0]) / np.radians(2.0) / rig.tractor.wheelbase_m
    return slope


def _grip(move: Increments, regressor: Array) -> Increments:
    """An extra share of the curvature."""
    zero = np.zeros_like(move.ahead)
    return Increments(zero, zero, regressor * move.turned)


def _push(stretch: Stretch, east: float, north: float) -> Increments:
    """A push of 1 m/s over the ground while the tractor moves."""
    dt, heading = np.diff(stretch.time), stretch.heading[:-1]
    moving = np.tanh(np.abs(stretch.speed[:-1]) / 0.1) * dt
    cosine, sine = np.cos(heading), np.sin(heading)
    zero = np.zeros_like(moving)
    return Increments((east * cosine + north * sine) * moving, (east * sine - north * cosine) * moving, zero)


def _faster(move: Increments, regressor: Array) -> Increments:
    zero = np.zeros_like(move.ahead)
    return Increments(regressor * move.ahead, zero, zero)


def _speed(stretch: Stretch) -> Array:
    return stretch.pace[:-1]


def _steering(stretch: Stretch) -> Array:
    angle = stretch.wheel if stretch.wheel is not None else stretch.command
    assert angle is not None
    return angle[:-1]


def _rate(stretch: Stretch) -> Array:
    angle = stretch.wheel if stretch.wheel is not None else stretch.command
    assert angle is not None
    rate: Array = np.gradient(angle, stretch.time)[:-1]
    return rate


def _waves(period: float, longest: float) -> list[Dependence]:
    def bent(stretch: Stretch, move: Increments, base: Array) -> Terms:
        phase = 2.0 * np.pi * stretch.time[:-1] / period
        return [_bend(move, wave(phase), base) for wave in (np.sin, np.cos)]

    def gripped(stretch: Stretch, move: Increments, base: Array) -> Terms:
        phase = 2.0 * np.pi * stretch.time[:-1] / period
        return [_grip(move, wave(phase)) for wave in (np.sin, np.cos)]

    back = period <= 0.5 * longest
    on = f"time, coming back every {period:.1f} s" if back else "time, changing slowly during a run"
    return [Dependence(on, "an extra wheel angle", bent, True), Dependence(on, "a change of grip", gripped, True)]


def dependences(bench: Bench) -> list[Dependence]:
    """All unnamed terms that the data could show."""
    terms = [
        Dependence("speed", "an extra wheel angle", lambda s, m, b: [_bend(m, _speed(s), b)]),
        Dependence("the square of speed", "an extra wheel angle", lambda s, m, b: [_bend(m, _speed(s) ** 2, b)]),
        Dependence(
            "time since the start", "an extra wheel angle", lambda s, m, b: [_bend(m, s.start_s + s.time[:-1], b)]
        ),
        Dependence(
            "the direction of travel", "an extra wheel angle",
            lambda s, m, b: [_bend(m, np.cos(s.heading[:-1]), b), _bend(m, np.sin(s.heading[:-1]), b)],
        ),
        Dependence("speed", "a change of grip", lambda s, m, b: [_grip(m, _speed(s))]),
        Dependence("the size of the wheel angle", "a change of grip", lambda s, m, b: [_grip(m, np.abs(_steering(s)))]),
        Dependence("the implement", "a change of grip", lambda s, m, b: [_grip(m, s.working[:-1])]),
        Dependence(
            "the direction of travel", "a change of grip",
            lambda s, m, b: [_grip(m, np.cos(s.heading[:-1])), _grip(m, np.sin(s.heading[:-1]))],
        ),
        Dependence("the rate of steering", "an extra wheel angle", lambda s, m, b: [_bend(m, _rate(s), b)]),
        Dependence(
            "the direction of travel and the time on the way", "a push over the ground",
            lambda s, m, b: [_push(s, 1.0, 0.0), _push(s, 0.0, 1.0)],
        ),
        Dependence("speed", DISTANCE, lambda s, m, b: [_faster(m, _speed(s))]),
        Dependence(ALWAYS, DISTANCE, lambda s, m, b: [_faster(m, np.ones(s.rows - 1))]),
        Dependence(
            "the wheel angle", DISTANCE, lambda s, m, b: [_faster(m, np.abs(_steering(s)))]
        ),
    ]  # fmt: skip
    if not all(stretch.speed_seen for stretch in bench.course.stretches):
        terms = [one for one in terms if one.changes != DISTANCE]
    longest = max(stretch.time[-1] for stretch in bench.course.stretches)
    row_s = max(float(np.median(np.diff(stretch.time))) for stretch in bench.course.stretches)
    fastest = FEWEST_ROWS_PER_PERIOD * row_s
    for period in PERIODS_S:
        if fastest < period < LONGEST_PERIOD * longest:
            terms += _waves(period, longest)
    return terms


@dataclass(frozen=True, eq=False)
class Score:
    """How much of what is left an unnamed term explains beyond the fit."""

    terms: Dependence
    gain: float
    freedoms: int


def scores(bench: Bench, fit: Fit) -> list[Score]:
    """Gains of all unnamed terms, the largest first."""
    response = Response(bench, fit)
    bends = [_per_angle(bench, stretch) for stretch in bench.course.stretches]
    ranked = []
    every, together = dependences(bench), _together(bench)
    for some in (every[first : first + together] for first in range(0, len(every), together)):
        parts = []
        for index, (stretch, move, bend) in enumerate(zip(bench.course.stretches, response.moves, bends, strict=True)):
            parts.append(response.sums(index, [terms.make(stretch, move, bend) for terms in some]))
        for terms, mine in zip(some, zip(*parts, strict=True), strict=True):
            ranked.append(Score(terms, *response.gain(mine, terms.per_run)))
    return sorted(ranked, key=lambda one: one.freedoms - one.gain)


def _together(bench: Bench) -> int:
    """Unnamed terms that go through the filter at once."""
    longest = max(stretch.rows for stretch in bench.course.stretches)
    return max(min(MOST_TOGETHER, MOST_ROWS // longest), 1)


def columns(bench: Bench, fit: Fit, terms: Dependence) -> Array:
    """Change of the whole vector of surprises per unit of each column of an unnamed term (n, c)."""
    response, every = Response(bench, fit), bench.course.stretches
    parts = [
        response.local(index, terms.make(stretch, move, _per_angle(bench, stretch)))
        for index, (stretch, move) in enumerate(zip(every, response.moves, strict=True))
    ]
    runs, found = [stretch.run if terms.per_run else 0 for stretch in every], []
    for run in sorted(set(runs)):
        mine = [(place, part) for place, part, its in zip(response.places, parts, runs, strict=True) if its == run]
        whole = np.zeros((parts[0].shape[1], 5 * bench.course.rows))
        for place, part in mine:
            whole[:, place] = part.T
        found.append(whole[np.max([np.abs(part).max(axis=0) for _, part in mine], axis=0) > LEAST_CHANGE])
    return np.concatenate(found).T


class Response:
    """How the surprises of the path answer to small changes of the simulated motion, stretch by stretch."""

    def __init__(self, bench: Bench, fit: Fit) -> None:
        """Replay the fit once."""
        self.bench, self.fit = bench, fit
        self.moves = bench.path(fit.settings)
        fields = effect_fields(fit.settings)
        self.lever, self.bias = antenna_lever(bench.rig, fields), fields["heading_bias"]
        self.now = [self._surprise(index, move) for index, move in enumerate(self.moves)]
        ends = np.cumsum([3 * stretch.rows for stretch in bench.course.stretches])
        self.places = [
            slice(int(end) - 3 * s.rows, int(end)) for end, s in zip(ends, bench.course.stretches, strict=True)
        ]
        self.inverse = np.linalg.pinv(crossed(fit.slope, fit.slope), rcond=1e-12, hermitian=True)
        self.side = crossed(fit.slope, fit.surprise)

    def _surprise(self, index: int, move: Increments) -> Array:
        stretch, filtered = self.bench.course.stretches[index], self.bench.filters[index]
        out = np.empty((stretch.rows, 3))
        innovations(
            filtered.kept, stretch.east, stretch.north, stretch.heading, move.ahead, move.aside, move.turned,
            *self.lever, self.bias, filtered.gains, filtered.roots, out,
        )  # fmt: skip
        out[0] = 0.0
        return out.ravel()

    def local(self, index: int, terms: Terms) -> Array:
        """Columns of one stretch (3 k, c): the filter is linear, so any size of a term will do."""
        on_the_way = np.array([term.ahead.any() or term.aside.any() for term in terms])
        if not on_the_way.any():
            return self._turned_by(index, terms)
        out = np.empty((3 * self.bench.course.stretches[index].rows, len(terms)))
        for moved, made in ((True, self._moved), (False, self._turned_by)):
            mine = np.flatnonzero(on_the_way == moved)
            if len(mine):
                out[:, mine] = made(index, [terms[place] for place in mine])
        return out

    def _turned_by(self, index: int, terms: Terms) -> Array:
        return self.turned(index, np.stack([term.turned for term in terms]))

    def turned(self, index: int, turns: Array, first: int = 0) -> Array:
        """Columns (3 k, c) of one stretch for turns (c, k - 1) that are added to those of its rows, from a row on."""
        stretch, move, filtered = self.bench.course.stretches[index], self.moves[index], self.bench.filters[index]
        rows = slice(first, first + turns.shape[1] + 1)
        out = np.zeros((turns.shape[1] + 1, 3, len(turns)))
        turn_responses(
            stretch.time[rows], stretch.heading[rows], move.ahead[rows], move.aside[rows], *self.lever,
            filtered.gains[rows], filtered.roots[rows], turns, out,
        )  # fmt: skip
        return out.reshape(-1, len(turns))

    def _moved(self, index: int, terms: Terms) -> Array:
        move, now = self.moves[index], self.now[index]
        parts = []
        for term in terms:
            moved = Increments(move.ahead + term.ahead, move.aside + term.aside, move.turned + term.turned)
            parts.append(self._surprise(index, moved) - now)
        return np.stack(parts, axis=1)

    def sums(self, index: int, each: Sequence[Terms]) -> list[Products]:
        """Products of the columns of several lists of terms in one stretch, per list."""
        made = np.asfortranarray(self.local(index, [term for terms in each for term in terms]))
        place = self._place_of(index, made, 0)
        side, cross = crossed(made, self.fit.surprise[place]), self._with_fit(made, place)
        ends = np.cumsum([len(terms) for terms in each])
        mine = [slice(int(end) - len(terms), int(end)) for end, terms in zip(ends, each, strict=True)]
        parts = [made[:, one] for one in mine]
        return [(crossed(part, part), side[one], cross[one]) for part, one in zip(parts, mine, strict=True)]

    def products_of_each(self, index: int, made: Array, first: int = 0) -> Products:
        """As products, of every column alone: squares (c,), products with what is left (c,) and with the fit (c, m)."""
        place, made = self._place_of(index, made, first), np.asfortranarray(made)
        return squares(made), crossed(made, self.fit.surprise[place]), self._with_fit(made, place)

    def products(self, index: int, made: Array, first: int = 0) -> Products:
        """Squares of columns (3 k, c), products with what is left, and with the columns of the fit, of one stretch.

        The columns are those of its rows from `first` on.
        """
        place, made = self._place_of(index, made, first), np.asfortranarray(made)
        return crossed(made, made), crossed(made, self.fit.surprise[place]), self._with_fit(made, place)

    def _place_of(self, index: int, made: Array, first: int) -> slice:
        """The surprises that columns of one stretch are of, from a row of it on."""
        start = self.places[index].start + 3 * first
        return slice(start, start + len(made))

    def _with_fit(self, made: Array, place: slice) -> Array:
        """Products (c, m) with the columns of the fit in a part of the surprises, which are looked at once."""
        key = place.start, place.stop
        if key not in self._slopes:
            slope = self.fit.slope[place]
            told = np.flatnonzero(slope.any(axis=0))  # many are of one run alone
            self._slopes[key] = told, np.asfortranarray(slope[:, told])
        told, columns = self._slopes[key]
        out = np.zeros((made.shape[1], self.fit.slope.shape[1]))
        out[:, told] = crossed(made, columns)
        return out

    @cached_property
    def _slopes(self) -> dict[tuple[int, int], tuple[npt.NDArray[np.int64], Array]]:
        """Columns of the fit that are not 0 in a part of the surprises, and which."""
        return {}

    def gain(self, parts: Sequence[Products], per_run: bool) -> tuple[float, int]:
        """Loss that columns take away beyond the fit, from their products per stretch, and how many are free."""
        square, side, cross = (np.stack([part[k] for part in parts]) for k in range(3))
        if per_run:
            return float(explained(square, side).sum()), side.size
        return self.beyond(square.sum(axis=0), side.sum(axis=0), cross.sum(axis=0)), side.shape[1]

    def beyond(self, square: Array, side: Array, cross: Array) -> float:
        """Explained loss once the columns of the fit have taken their share."""
        share = cross @ self.inverse
        return float(explained(square - share @ cross.T, side - share @ self.side))


def explained(square: Array, side: Array) -> Array:
    """Loss (...) that columns take away, from their products (..., c, c) and those with what is left (..., c)."""
    scale = np.sqrt(np.maximum(np.diagonal(square, axis1=-2, axis2=-1), 1e-12))
    scaled = side / scale
    if side.shape[-1] == 1:
        size = square[..., 0, 0] / scale[..., 0] ** 2
        return np.asarray(np.where(size > 0.0, scaled[..., 0] ** 2 / np.where(size > 0.0, size, 1.0), 0.0))
    unit = square / (scale[..., :, None] * scale[..., None, :])
    inverse = np.linalg.pinv(unit, rcond=1e-6, hermitian=True)
    return np.asarray(np.einsum("...i,...ij,...j", scaled, inverse, scaled))
