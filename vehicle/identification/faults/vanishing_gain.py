"""Paths that bend too little by a law of the steering gain, told from wheels that stop following.

Where wheels stop following, the path follows them before and does not from one moment on. A gain that falls with speed,
angle, place or time falls by degrees, falls again where the tractor comes again, or was never right in the run. What is
compared is the share of the expected angle that the path needs, over blocks of a second.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vehicle.identification.faults.steering_evidence import STEP_S, PathScale, SteeringEvidence
from vehicle.identification.logs.schema import Array, Log, Mask, Rows

_BLOCK_S = 1.0
_LEAST_ANGLE_DEG, _MOST_ERROR = 2.5, 0.15  # chosen: of a block that shows a share
# Chosen, shares: a path that follows, and one that does not; sliding tyres and tolerances are between 0.8 and 1.35.
_FOLLOWS, _FOLLOWS_NOT, _MOST_SHARE = 0.8, 0.35, 1.35
_LAST_BLOCKS, _FEWEST_BLOCKS = 4, 3
_BETWEEN_SHARE = 0.25  # chosen, of the blocks outside faults: more that bend by half follow a law
# Chosen: how far angles differ (deg) that show a proportion, its least share, and how far shares scatter about it.
_LEAST_CHANGE_DEG, _LEAST_PROPORTION, _MOST_SCATTER_SHARE = 8.0, 0.2, 0.25
_ALIKE_SHARE, _FEWEST_ALIKE = 0.2, 6  # chosen: angles of about the same size, and the fewest blocks with such
# Chosen: the same place, pace and angle, and the share of blocks of other runs there that do not follow either.
_NEAR_M, _ALIKE_PACE_MPS, _ALIKE_ANGLE_SHARE, _AGAIN_SHARE = 2.0, 0.1, 0.1, 0.5


@dataclass(frozen=True, eq=False)
class PathShares:
    """Blocks of one segment (k,): first row on its grid, the share of the expected angle that the path needs, that
    angle (deg), pace (m/s), and place (2, k) in m."""

    rows: Rows
    shares: Array
    angles: Array
    paces: Array
    places: Array


def measure_path_shares(log: Log, segment: SteeringEvidence, scale: PathScale) -> PathShares:
    """Measure the blocks of a segment in which the expected angle is large enough to show a share."""
    expected = segment.usual if segment.wheel is None else segment.wheel
    needed = scale.compute_needed_angle(segment.curvature)
    width = round(_BLOCK_S / STEP_S)
    rows, shares, angles, paces = list[int](), list[float](), list[float](), list[float]()
    for first in range(0, len(expected) - width + 1, width):
        block = slice(first, first + width)
        known = np.isfinite(needed[block])
        energy = float(np.sum(expected[block][known] ** 2))
        large = float(np.min(np.abs(expected[block]))) > _LEAST_ANGLE_DEG
        if large and known.all() and scale.sigma_deg / math.sqrt(energy) < _MOST_ERROR:
            rows.append(first)
            shares.append(float(needed[block] @ expected[block]) / energy)
            angles.append(float(np.mean(expected[block])))
            paces.append(float(np.mean(segment.pace[block])))
    used = np.flatnonzero(log.used)
    middle_s = segment.time_s[np.array(rows, dtype=np.int64)] + 0.5 * _BLOCK_S
    places = np.stack([np.interp(middle_s, log.time_s[used], axis[used]) for axis in (log.easting_m, log.northing_m)])
    return PathShares(np.array(rows, dtype=np.int64), np.array(shares), np.array(angles), np.array(paces), places)


@dataclass(frozen=True)
class PathSpan:
    """Rows of a segment in which the path does not bend as expected: the run, its segment, first and last row."""

    run: int
    segment: int
    first: int
    last: int


def find_spans_by_law(spans: Sequence[PathSpan], measured: Sequence[Sequence[PathShares]]) -> set[PathSpan]:
    """Return the spans that a law of the gain explains; `measured` are the blocks by run and segment."""
    outside = [
        ~_find_inside(part, run, number, spans)
        for run, parts in enumerate(measured)
        for number, part in enumerate(parts)
    ]
    usual = _UsualShares(
        *(
            np.concatenate(
                [getattr(part, name)[chosen] for part, chosen in zip(_chain(measured), outside, strict=True)]
            )
            for name in ("angles", "shares")
        )
    )
    blocks = [[replace(part, shares=usual.compute_relative(part)) for part in parts] for parts in measured]
    every = np.concatenate([part.shares[chosen] for part, chosen in zip(_chain(blocks), outside, strict=True)])
    if len(every) >= _FEWEST_BLOCKS and float(np.mean(_is_between(every))) > _BETWEEN_SHARE:
        return set(spans)
    return {
        span
        for span in spans
        if _fades_in(span, blocks[span.run])
        or _fades_again(
            span, measured, lambda part: np.abs(part.angles)[None], lambda angle: _ALIKE_ANGLE_SHARE * angle[0]
        )
        or _fades_again(span, blocks, lambda part: part.paces[None], lambda _: _ALIKE_PACE_MPS)
        or _fades_again(span, blocks, lambda part: part.places, lambda _: _NEAR_M)
        or _is_in_proportion(span, blocks[span.run][span.segment])
    }


def _chain(blocks: Sequence[Sequence[PathShares]]) -> list[PathShares]:
    return [part for parts in blocks for part in parts]


@dataclass(frozen=True, eq=False)
class _UsualShares:
    """Shares (k,) of all blocks without a fault by their angles (k, deg): the scale of angles is no straight line."""

    angles: Array
    shares: Array

    def compute_relative(self, part: PathShares) -> Array:
        """Return the shares of a segment over the usual ones at angles of about that size."""
        sizes, relative = np.abs(self.angles), part.shares.copy()
        for number, angle in enumerate(np.abs(part.angles)):
            near = np.abs(sizes - angle) < max(_ALIKE_SHARE * angle, _LEAST_ANGLE_DEG)
            if np.count_nonzero(near) >= _FEWEST_ALIKE:
                relative[number] /= max(float(np.median(self.shares[near])), _LEAST_PROPORTION)
        return relative


def _is_between(shares: Array) -> Mask:
    between: Mask = ((shares > _FOLLOWS_NOT) & (shares < _FOLLOWS)) | (shares > _MOST_SHARE)
    return between


def _find_inside(shares: PathShares, run: int, segment: int, spans: Collection[PathSpan]) -> Mask:
    inside = np.zeros(len(shares.rows), dtype=np.bool_)
    for span in spans:
        if (span.run, span.segment) == (run, segment):
            inside |= (shares.rows >= span.first) & (shares.rows <= span.last)
    return inside


def _fades_in(span: PathSpan, parts: Sequence[PathShares]) -> bool:
    """Whether the path bent too little before a span already, or never as expected."""
    before = [part.shares for part in parts[: span.segment]]
    before.append(parts[span.segment].shares[parts[span.segment].rows < span.first])
    shares = np.concatenate(before)
    if len(shares) < _FEWEST_BLOCKS:
        return False
    if not np.any(shares > _FOLLOWS):
        return True
    return float(np.mean(_is_between(shares[-_LAST_BLOCKS:]))) > 0.5


def _is_in_proportion(span: PathSpan, part: PathShares) -> bool:
    """Whether the path of a span bends by one share of angles that differ, as wheels that do not follow never do."""
    inside = _find_inside(part, span.run, span.segment, [span])
    if np.count_nonzero(inside) < _FEWEST_BLOCKS:
        return False
    low, high = np.quantile(part.angles[inside], (0.2, 0.8))
    middle = float(np.median(part.shares[inside]))
    scatter = 1.4826 * float(np.median(np.abs(part.shares[inside] - middle)))
    return high - low > _LEAST_CHANGE_DEG and middle > _LEAST_PROPORTION and scatter < _MOST_SCATTER_SHARE * middle


Covariate = Callable[[PathShares], Array]
"""What a gain may depend on, per block of a segment (n, k)."""


def _fades_again(
    span: PathSpan,
    blocks: Sequence[Sequence[PathShares]],
    covariate: Covariate,
    compute_reach: Callable[[Array], float],
) -> bool:
    """Whether other runs do not bend as expected either where a covariate is as in a span."""
    own = blocks[span.run][span.segment]
    inside = _find_inside(own, span.run, span.segment, [span])
    lost = inside & (own.shares < _FOLLOWS_NOT)
    bad = lost if lost.any() else inside & ~_is_as_expected(own.shares)
    others = [part for run, parts in enumerate(blocks) if run != span.run for part in parts if len(part.rows)]
    if not bad.any() or not others:
        return False
    values = np.concatenate([covariate(part) for part in others], axis=1)
    shares = np.concatenate([part.shares for part in others])
    near = np.zeros(len(shares), dtype=np.bool_)
    for value in covariate(own)[:, bad].T:
        near |= np.linalg.norm(values - value[:, None], axis=0) < compute_reach(value)
    return (
        bool(np.count_nonzero(near) >= _FEWEST_BLOCKS) and float(np.mean(~_is_as_expected(shares[near]))) > _AGAIN_SHARE
    )


def _is_as_expected(shares: Array) -> Mask:
    follows: Mask = (shares > _FOLLOWS) & (shares < _MOST_SHARE)
    return follows
