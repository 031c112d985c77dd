"""The kinds of effect: how the values of an effect become coordinates that a fit can move, and back.

A fit needs coordinates in which an effect grows steadily from neutral and has a slope everywhere. Most effects are a
number that is one already; a limit that is never reached is infinite and enters by its inverse, a size with a bearing
by its two components, a size inside a circle with the circle searched for beforehand. Whatever a diagnosis asks that
depends on this is asked of the kind: a new kind is one class here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

USUAL_WHEELBASE_M = 2.4  # of the EG105, to which the sizes in the catalogue belong
HELD = 0.95  # of all tractors that are like the one measured: what an interval is to hold
SURE = 1.96  # standard deviations either side of a normal distribution that hold so much
KNEE_SHARE = 0.15  # chosen, of a limit: tyre curves differ by about as much in how they come to slide
USUAL_INVERSE = 4.0  # chosen, 1/g: the first step of a fit, 0.3 of it, goes from no limit to one of 0.8 g
PER_SLOPE = "per_slope"  # the value of a drift on a slope that was measured
ROUNDED = 1.001  # a size that equals the usual one but for rounding is as fine

Array = npt.NDArray[np.float64]
Interval = tuple[float, float]
Values = Mapping[str, float]
Circle = tuple[float, float, float]


@dataclass(frozen=True)
class Param:
    """A number of an effect. `neutral` None stands for the value in the tractor file; `place` says where, not how much.

    `typical` is the size of a usual fault, `finest` the smallest that the base model's own simplifications allow to be
    claimed, `low` and `high` what a tractor can have.
    """

    name: str
    unit: str
    neutral: float | None
    typical: float
    finest: float
    low: float
    high: float
    place: bool = False
    metres: int = 0

    def for_wheelbase(self, wheelbase_m: float) -> Param:
        """The same parameter for a vehicle of another size: lengths and curvatures scale with the wheelbase.

        `metres` is the power of metres in the unit that scales so.
        """
        factor = (wheelbase_m / USUAL_WHEELBASE_M) ** self.metres
        wider = max(factor, 1.0)
        return replace(
            self,
            typical=self.typical * factor,
            finest=self.finest * factor,
            low=self.low * wider,
            high=self.high * wider,
        )


class Box(NamedTuple):
    """Coordinates of an effect: one value per coordinate, and vectors to try first, in this order."""

    neutral: tuple[float, ...]
    typical: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    starts: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Draw:
    """How a demonstration hides an effect: `share` of its usual size, only ever less than neutral, and a place."""

    share: float
    less: bool
    place: Circle


class Kind:
    """The ordinary kind: an effect with one number, which is its own coordinate.

    Attributes: `searched` is whether the place of the effect is searched for before its size is fitted, `size_word`
    stands before a size that would have shown. Methods take the parameters of the effect, the first of which is its
    size, and coordinates `at` (m,).
    """

    searched: bool = False
    size_word: str = ""

    def box(self, size: Param, zero: float, starts: Sequence[float]) -> Box:
        """Coordinates for a size (of the vehicle at hand) that is neutral at `zero`; `starts` are values to try."""
        return Box((zero,), (size.typical,), (size.low,), (size.high,), _singles(starts or (zero,)))

    def values(self, params: Sequence[Param], at: Array, place: Sequence[float] = ()) -> dict[str, float]:
        """Values of the effect; `place` are those that were searched for."""
        return dict(zip([param.name for param in params], [*map(float, at), *place], strict=True))

    def coordinates(self, params: Sequence[Param], values: Values) -> tuple[Array, tuple[float, ...]]:
        """Coordinates (m,) and place of values: `values(params, *coordinates(params, v))` gives `v` again."""
        return np.array([values[params[0].name]]), tuple(values[param.name] for param in params[1:])

    def on(self, place: Sequence[float]) -> Kind:
        """The kind where its place is known beforehand: the same, unless another one then tells more."""
        return self

    def deviation(self, neutral: Sequence[float], at: Array) -> float:
        """How far coordinates are from neutral."""
        return float(np.linalg.norm(at - np.array(neutral)))

    def interval(
        self, params: Sequence[Param], box: Box, at: Array, covariance: Array, finest: float
    ) -> dict[str, Interval]:
        """95 % interval of the values from the covariance (m, m) of the coordinates, never finer than `finest`.

        Where an effect is was searched for and not fitted: no interval is claimed for it.
        """
        name, value = params[0].name, float(at[0])
        wide = math.hypot(SURE * float(_sigma(covariance)[0]), finest)
        return {name: (max(value - wide, float(box.low[0])), min(value + wide, float(box.high[0])))}

    def as_fine(self, smallest: float, typical: float) -> bool:
        """Whether a size of `smallest` is no larger a fault than the typical one."""
        return smallest <= ROUNDED * typical

    def smallest(self, tried: Array, share: float, typical: float, finest: float) -> float:
        """Size that would just show, when coordinates `tried` did show and `share` of the typical one would have."""
        return max(finest, share * typical)

    def drawn(self, params: Sequence[Param], neutral: Values, draw: Draw, rng: np.random.Generator) -> dict[str, float]:
        """Values of an effect to hide, to either side of neutral where a tractor can have both."""
        size = params[0]
        both = size.low < neutral[size.name] - size.typical
        sign = -1.0 if both and rng.random() < 0.5 else 1.0
        if draw.less:
            sign = -1.0
        return {**neutral, size.name: round(neutral[size.name] + sign * draw.share * size.typical, 4)}


class Limit(Kind):
    """A limit above which something happens; the coordinate is its inverse, 0 where it is never reached."""

    size_word = "limit "

    def box(self, size: Param, zero: float, starts: Sequence[float]) -> Box:
        """One coordinate from 0; `starts` are inverses."""
        return Box((0.0,), (USUAL_INVERSE,), (0.0,), (1.0 / size.low,), _singles(starts))

    def values(self, params: Sequence[Param], at: Array, place: Sequence[float] = ()) -> dict[str, float]:
        """The limit, infinite at 0."""
        return {params[0].name: math.inf if at[0] <= 0.0 else 1.0 / float(at[0])}

    def coordinates(self, params: Sequence[Param], values: Values) -> tuple[Array, tuple[float, ...]]:
        """The inverse; that of an infinite limit is 0."""
        return np.array([1.0 / values[params[0].name]]), ()

    def interval(
        self, params: Sequence[Param], box: Box, at: Array, covariance: Array, finest: float
    ) -> dict[str, Interval]:
        """Interval of the limit: that of the inverse turned over, open above where the inverse may be 0."""
        middle = float(at[0])
        wide = max(SURE * float(_sigma(covariance)[0]), KNEE_SHARE * middle)
        most, least = middle + wide, middle - wide
        return {params[0].name: (1.0 / most if most > 0.0 else math.inf, 1.0 / least if least > 0.0 else math.inf)}

    def as_fine(self, smallest: float, typical: float) -> bool:
        """The finer limit is the larger one: a limit that is never reached is no limit."""
        return smallest >= typical

    def smallest(self, tried: Array, share: float, typical: float, finest: float) -> float:
        """The limit that was tried: below what was driven it has no trace, so no other can be told from it."""
        return 1.0 / float(tried[0])

    def drawn(self, params: Sequence[Param], neutral: Values, draw: Draw, rng: np.random.Generator) -> dict[str, float]:
        """A limit that much lower than the usual one."""
        return {params[0].name: round(params[0].typical / draw.share, 3)}


class Slope(Kind):
    """A size with a bearing (deg, clockwise from north); the coordinates are its components to east and to north."""

    def box(self, size: Param, zero: float, starts: Sequence[float]) -> Box:
        """Two coordinates about 0, where all bearings are the same."""
        typical, high = size.typical, size.high
        return Box((0.0, 0.0), (typical, typical), (-high, -high), (high, high), ((0.0, 0.0),))

    def values(self, params: Sequence[Param], at: Array, place: Sequence[float] = ()) -> dict[str, float]:
        """Length and bearing of the components, the length no more than a tractor can have."""
        size, bearing = params
        length = min(float(np.hypot(at[0], at[1])), size.high)
        return {size.name: length, bearing.name: math.degrees(math.atan2(at[0], at[1])) % 360.0}

    def coordinates(self, params: Sequence[Param], values: Values) -> tuple[Array, tuple[float, ...]]:
        """The components to east and to north."""
        length, bearing = values[params[0].name], math.radians(values[params[1].name])
        return np.array([length * math.sin(bearing), length * math.cos(bearing)]), ()

    def interval(
        self, params: Sequence[Param], box: Box, at: Array, covariance: Array, finest: float
    ) -> dict[str, Interval]:
        """Intervals of size and bearing: the spread of the components along and across the slope."""
        ratio, bearing = self.values(params, at).values()
        along = at / max(ratio, 1e-9)
        across = np.array([along[1], -along[0]])
        wide, aside = (
            math.hypot(SURE * math.sqrt(max(float(way @ covariance @ way), 0.0)), finest) for way in (along, across)
        )
        # Beyond three times the size the bearing is anyone's guess.
        turn = math.degrees(math.atan2(aside, ratio)) if aside < 3.0 * ratio else 180.0
        return {
            params[0].name: (max(ratio - wide, 0.0), ratio + wide),
            params[1].name: (bearing - turn, bearing + turn),
        }

    def on(self, place: Sequence[float]) -> Kind:
        """On a slope that was measured the drift is one value."""
        return OnSlope(*place) if place else self

    def drawn(self, params: Sequence[Param], neutral: Values, draw: Draw, rng: np.random.Generator) -> dict[str, float]:
        """A size, and any bearing."""
        values = super().drawn(params, neutral, draw, rng)
        return {**values, params[1].name: round(float(rng.uniform(0.0, 360.0)), 1)}


@dataclass(frozen=True)
class OnSlope(Kind):
    """A size with a bearing on ground whose slope was measured: there the drift per slope is all that is fitted.

    `fall` is the mean slope of the ground and `bearing_deg` where that falls to, `usual` the root mean square of the
    slope across the way. The coordinate is the drift across the usual slope, as large as that on a slope not measured.
    """

    fall: float
    bearing_deg: float
    usual: float

    def box(self, size: Param, zero: float, starts: Sequence[float]) -> Box:
        """One coordinate from 0: no tractor drifts uphill."""
        return Box((0.0,), (size.typical,), (0.0,), (size.high,), ((0.0,),))

    def values(self, params: Sequence[Param], at: Array, place: Sequence[float] = ()) -> dict[str, float]:
        """Size and bearing on the mean slope, and the drift per slope."""
        share = float(at[0]) / self.usual
        return {params[0].name: share * self.fall, params[1].name: self.bearing_deg, PER_SLOPE: share}

    def interval(
        self, params: Sequence[Param], box: Box, at: Array, covariance: Array, finest: float
    ) -> dict[str, Interval]:
        """Intervals of the size and of the drift per slope; the bearing is that of the ground."""
        wide = math.hypot(SURE * float(_sigma(covariance)[0]), finest)
        low, high = max(float(at[0]) - wide, 0.0) / self.usual, (float(at[0]) + wide) / self.usual
        return {params[0].name: (low * self.fall, high * self.fall), PER_SLOPE: (low, high)}


class Inside(Kind):
    """A size inside a circle that is searched for (east, north, radius in m); the coordinate is the size."""

    searched = True

    def drawn(self, params: Sequence[Param], neutral: Values, draw: Draw, rng: np.random.Generator) -> dict[str, float]:
        """A size inside the circle of the draw."""
        values = super().drawn(params, neutral, draw, rng)
        return {**values, **dict(zip([param.name for param in params[1:]], draw.place, strict=True))}


SIZE, LIMIT, SLOPE, CIRCLE = Kind(), Limit(), Slope(), Inside()


def _singles(values: Sequence[float]) -> tuple[tuple[float, ...], ...]:
    return tuple((value,) for value in values)


def _sigma(covariance: Array) -> Array:
    out: Array = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return out
