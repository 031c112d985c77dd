"""The kinds of effect: how the values of an effect become coordinates of a fit, and back.

A fit needs coordinates in which an effect grows steadily from neutral and has a slope everywhere. Most effects have one
number that is such a coordinate already; a limit enters by its inverse, as one that is never reached is infinite; a
size with a bearing by its two components; a size inside a circle after a search for the circle. A diagnosis leaves all
that depends on this to the kind, so a new kind is one class here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from fields.arrays import Floats

REFERENCE_WHEELBASE_M = 2.4  # of the EG105, to which the sizes in the catalogue belong
INTERVAL_COVERAGE = 0.95
INTERVAL_SIGMAS = NormalDist().inv_cdf(0.5 + 0.5 * INTERVAL_COVERAGE)  # either side of the mean
# Of a limit: tyre curves differ by this much in how they begin to slide. Tyres that begin suddenly (second reference,
# 0.09 g) are read 18 to 23 % high.
KNEE_SHARE = 0.24
TYPICAL_INVERSE_PER_G = 4.0  # chosen, 1/g: the first step of a fit, 0.3 of it, goes from no limit to one of 0.8 g
PER_SLOPE = "per_slope"  # the value of a drift on a slope that was measured
ROUNDING_FACTOR = 1.001  # a size that differs from the typical one only by rounding is as fine

Interval = tuple[float, float]
Values = Mapping[str, float]
CirclePlace = tuple[float, float, float]


@dataclass(frozen=True)
class EffectParameter:
    """A number of an effect. `neutral` None stands for the value in the tractor file.

    `typical` is the size of a usual fault, `finest` the smallest that can be claimed despite the simplifications of the
    base model, `low` and `high` the limits of what a tractor can have. `length_power` is the power of metres in the
    unit that scales with the wheelbase.
    """

    name: str
    unit: str
    neutral: float | None
    typical: float
    finest: float
    low: float
    high: float
    length_power: int = 0

    def scale_to_wheelbase(self, wheelbase_m: float) -> EffectParameter:
        """The same parameter for a vehicle of another size: lengths and curvatures scale with the wheelbase."""
        factor = (wheelbase_m / REFERENCE_WHEELBASE_M) ** self.length_power
        wider = max(factor, 1.0)
        typical, finest = self.typical * factor, self.finest * factor
        return replace(self, typical=typical, finest=finest, low=self.low * wider, high=self.high * wider)


Parameters = Sequence[EffectParameter]


class CoordinateBox(NamedTuple):
    """Bounds of the coordinates of an effect: one value per coordinate."""

    neutral: tuple[float, ...]
    typical: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True)
class EffectSample:
    """How a demonstration hides an effect: the `share` of its typical size, whether only below neutral, and a place."""

    share: float
    only_less: bool
    place: CirclePlace


class EffectKind:
    """The ordinary kind: an effect with one number, which is its own coordinate.

    `size_word` precedes the smallest detectable size in texts. Methods take the parameters of the effect, the first of
    which is its size, and `coordinates` (m,).
    """

    size_word: str = ""

    def build_box(self, size: EffectParameter, zero: float) -> CoordinateBox:
        """Coordinates for a size (of the vehicle at hand) that is neutral at `zero`."""
        return CoordinateBox((zero,), (size.typical,), (size.low,), (size.high,))

    def compute_values(self, params: Parameters, coordinates: Floats, place: Sequence[float] = ()) -> dict[str, float]:
        """Values of the effect; `place` holds those that were searched for."""
        return dict(zip([param.name for param in params], [*map(float, coordinates), *place], strict=True))

    def get_kind_for_place(self, place: Sequence[float]) -> EffectKind:
        """The kind to use when the place of the effect is known beforehand."""
        return self

    def compute_interval(
        self, params: Parameters, box: CoordinateBox, coordinates: Floats, covariance: Floats
    ) -> dict[str, Interval]:
        """95 % interval of the values from the covariance (m, m) of the coordinates.

        The place of an effect was searched for and not fitted: it has no interval.
        """
        name, value = params[0].name, float(coordinates[0])
        half_width = _compute_half_width(covariance)
        return {name: (max(value - half_width, float(box.low[0])), min(value + half_width, float(box.high[0])))}

    def is_no_larger_fault(self, smallest: float, typical: float) -> bool:
        """Whether a size of `smallest` is no larger a fault than the `typical` one."""
        return smallest <= ROUNDING_FACTOR * typical

    def compute_smallest_detectable(self, tried: Floats, share: float, typical: float, finest: float) -> float:
        """The smallest detectable size, when `tried` coordinates were detected and `share` of the typical would be."""
        return max(finest, share * typical)

    def sample_values(
        self, params: Parameters, neutral: Values, sample: EffectSample, rng: np.random.Generator
    ) -> dict[str, float]:
        """Values of an effect to hide, to either side of neutral where a tractor can have both."""
        size = params[0]
        both = size.low < neutral[size.name] - size.typical
        sign = -1.0 if both and rng.random() < 0.5 else 1.0
        if sample.only_less:
            sign = -1.0
        return {**neutral, size.name: round(neutral[size.name] + sign * sample.share * size.typical, 4)}


@dataclass(frozen=True)
class OneSidedKind(EffectKind):
    """A number of which only one side is fitted, because the other side is another effect: `sign` times it is positive.

    A tractor file may hold both sides; both are fitted where a place, here any number, says that the logs show the
    other side.
    """

    sign: float = 1.0

    def get_kind_for_place(self, place: Sequence[float]) -> EffectKind:
        """Both sides with a place."""
        return TwoSidedKind() if place else self

    def build_box(self, size: EffectParameter, zero: float) -> CoordinateBox:
        """The ordinary box, cut at neutral."""
        box = super().build_box(size, zero)
        return box._replace(low=(zero,)) if self.sign > 0.0 else box._replace(high=(zero,))

    def sample_values(
        self, params: Parameters, neutral: Values, sample: EffectSample, rng: np.random.Generator
    ) -> dict[str, float]:
        """Values on the side that is fitted."""
        size = params[0]
        return {**neutral, size.name: round(neutral[size.name] + self.sign * sample.share * size.typical, 4)}


class TwoSidedKind(EffectKind):
    """Both sides of a number that is usually fitted on one side."""

    def compute_values(self, params: Parameters, coordinates: Floats, place: Sequence[float] = ()) -> dict[str, float]:
        """The coordinate."""
        return super().compute_values(params, coordinates)


class LimitKind(EffectKind):
    """A limit above which something happens; the coordinate is its inverse, 0 where it is never reached."""

    size_word = "limit "

    def build_box(self, size: EffectParameter, zero: float) -> CoordinateBox:
        """One coordinate from 0."""
        return CoordinateBox((0.0,), (TYPICAL_INVERSE_PER_G,), (0.0,), (1.0 / size.low,))

    def compute_values(self, params: Parameters, coordinates: Floats, place: Sequence[float] = ()) -> dict[str, float]:
        """The limit, infinite at 0."""
        return {params[0].name: math.inf if coordinates[0] <= 0.0 else 1.0 / float(coordinates[0])}

    def compute_interval(
        self, params: Parameters, box: CoordinateBox, coordinates: Floats, covariance: Floats
    ) -> dict[str, Interval]:
        """The inverted interval of the inverse, without an upper end where the inverse may be 0."""
        middle = float(coordinates[0])
        half_width = max(_compute_half_width(covariance), KNEE_SHARE * middle)
        most, least = middle + half_width, middle - half_width
        return {params[0].name: (1.0 / most if most > 0.0 else math.inf, 1.0 / least if least > 0.0 else math.inf)}

    def is_no_larger_fault(self, smallest: float, typical: float) -> bool:
        """A larger limit is the finer one: a limit that is never reached is no limit."""
        return smallest >= typical

    def compute_smallest_detectable(self, tried: Floats, share: float, typical: float, finest: float) -> float:
        """The limit that was tried: limits that the drive did not reach leave no trace and cannot be distinguished."""
        return 1.0 / float(tried[0])

    def sample_values(
        self, params: Parameters, neutral: Values, sample: EffectSample, rng: np.random.Generator
    ) -> dict[str, float]:
        """A limit lower than the typical one by the share of the sample."""
        return {params[0].name: round(params[0].typical / sample.share, 3)}


class SlopeKind(EffectKind):
    """A size with a bearing (deg, clockwise from north); the coordinates are its components to east and to north."""

    def build_box(self, size: EffectParameter, zero: float) -> CoordinateBox:
        """Two coordinates around 0, where the bearing has no meaning."""
        typical, high = size.typical, size.high
        return CoordinateBox((0.0, 0.0), (typical, typical), (-high, -high), (high, high))

    def compute_values(self, params: Parameters, coordinates: Floats, place: Sequence[float] = ()) -> dict[str, float]:
        """Length and bearing of the components; the length is limited to what a tractor can have."""
        size, bearing = params
        length = min(float(np.hypot(coordinates[0], coordinates[1])), size.high)
        return {size.name: length, bearing.name: math.degrees(math.atan2(coordinates[0], coordinates[1])) % 360.0}

    def compute_interval(
        self, params: Parameters, box: CoordinateBox, coordinates: Floats, covariance: Floats
    ) -> dict[str, Interval]:
        """Intervals of size and bearing: the spread of the components along and across the slope."""
        ratio, bearing = self.compute_values(params, coordinates).values()
        along = coordinates / max(ratio, 1e-9)
        across = np.array([along[1], -along[0]])
        half_width, aside = (
            INTERVAL_SIGMAS * math.sqrt(max(float(direction @ covariance @ direction), 0.0))
            for direction in (along, across)
        )
        # With a spread beyond three times the size any bearing is possible.
        turn = math.degrees(math.atan2(aside, ratio)) if aside < 3.0 * ratio else 180.0
        return {
            params[0].name: (max(ratio - half_width, 0.0), ratio + half_width),
            params[1].name: (bearing - turn, bearing + turn),
        }

    def get_kind_for_place(self, place: Sequence[float]) -> EffectKind:
        """On a slope that was measured the drift is one value."""
        return MeasuredSlopeKind(*place) if place else self

    def sample_values(
        self, params: Parameters, neutral: Values, sample: EffectSample, rng: np.random.Generator
    ) -> dict[str, float]:
        """A size, and any bearing."""
        values = super().sample_values(params, neutral, sample, rng)
        return {**values, params[1].name: round(float(rng.uniform(0.0, 360.0)), 1)}


@dataclass(frozen=True)
class MeasuredSlopeKind(EffectKind):
    """A size with a bearing on ground whose slope was measured: only the drift per slope is fitted.

    `mean_slope` is the mean slope of the ground, `bearing_deg` the direction it falls to, `usual_slope` the root mean
    square of the slope across the direction of travel. The coordinate is the drift across the usual slope, which has
    the same scale as on a slope that was not measured.
    """

    mean_slope: float
    bearing_deg: float
    usual_slope: float

    def build_box(self, size: EffectParameter, zero: float) -> CoordinateBox:
        """One coordinate from 0: no tractor drifts uphill."""
        return CoordinateBox((0.0,), (size.typical,), (0.0,), (size.high,))

    def compute_values(self, params: Parameters, coordinates: Floats, place: Sequence[float] = ()) -> dict[str, float]:
        """Size and bearing on the mean slope, and the drift per slope."""
        share = float(coordinates[0]) / self.usual_slope
        return {params[0].name: share * self.mean_slope, params[1].name: self.bearing_deg, PER_SLOPE: share}

    def compute_interval(
        self, params: Parameters, box: CoordinateBox, coordinates: Floats, covariance: Floats
    ) -> dict[str, Interval]:
        """Intervals of the size and of the drift per slope; the bearing is known from the ground."""
        half_width = _compute_half_width(covariance)
        low = max(float(coordinates[0]) - half_width, 0.0) / self.usual_slope
        high = (float(coordinates[0]) + half_width) / self.usual_slope
        return {params[0].name: (low * self.mean_slope, high * self.mean_slope), PER_SLOPE: (low, high)}


class CircleKind(EffectKind):
    """A size inside a circle that is searched for (east, north, radius in m); the coordinate is the size."""

    def sample_values(
        self, params: Parameters, neutral: Values, sample: EffectSample, rng: np.random.Generator
    ) -> dict[str, float]:
        """A size inside the circle of the sample."""
        values = super().sample_values(params, neutral, sample, rng)
        return {**values, **dict(zip([param.name for param in params[1:]], sample.place, strict=True))}


SIZE, LIMIT, SLOPE, CIRCLE = EffectKind(), LimitKind(), SlopeKind(), CircleKind()
ABOVE, BELOW = OneSidedKind(1.0), OneSidedKind(-1.0)


def _compute_half_width(covariance: Floats) -> float:
    """Half of the 95 % interval of the first coordinate, from the covariance (m, m)."""
    return INTERVAL_SIGMAS * math.sqrt(max(float(covariance[0, 0]), 0.0))
