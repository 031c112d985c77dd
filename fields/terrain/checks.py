"""What heights cannot be used for a field: holes, another place, spikes, units, slopes that no machine works.

Every refusal and remark says the value, the rule and what to do.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fields.arrays import Flags, Floats
from fields.geometry.field import Field
from fields.terrain.elevation_grid import ElevationError

MAX_FILLED_SHARE, MAX_FILLED_M, MIN_REPORTED_SHARE = 0.05, 30.0, 0.002
"""Share of a field without heights, and distance to the nearest one, that are filled in; smaller shares go unsaid."""
LOWEST_M, HIGHEST_M = -500.0, 6000.0
"""No farmland lies lower than the shore of the Dead Sea or higher than the Himalaya is grazed."""
MAX_SLOPE, MAX_STEEP_SHARE = 0.6, 0.01
"""Steepest slope of worked ground (mowers on slopes reach it), and share of a field that may be steeper: banks."""
MAX_USUAL_SLOPE = 0.25
"""Median slope of a field above which a reader is asked whether that is so. Chosen: few fields are that steep."""
MIN_SPIKE_M, MAX_SPIKE_SHARE = 5.0, 0.01


def describe_place(field: Field, x_m: float, y_m: float) -> str:
    """A place of the field in degrees, or in metres where its degrees are unknown."""
    if field.crs is None:
        return f"x {x_m:.0f} m, y {y_m:.0f} m"
    longitude, latitude = field.to_wgs84([[x_m, y_m]])[0]
    return f"longitude {longitude:.5f}, latitude {latitude:.5f}"


def check_coverage(measured: Flags, inside: Flags, spacing_m: float, label: str, field: Field) -> list[str]:
    """Remarks on ground of the field without heights, whose source is called `label` in messages.

    `measured` and `inside` (rows, columns) say whether a node has a height of its own, and is in the field. Raises
    ElevationError where too much of the field has none, or it is too far from those that are there.
    """
    from scipy.ndimage import distance_transform_edt

    gaps = inside & ~measured
    if not gaps.any():
        return []
    if not (inside & measured).any():
        raise ElevationError(
            f"{label} has no heights in field '{field.name}'; give heights of the field, or name their system if they "
            "are in another one."
        )
    share = float(gaps.sum() / inside.sum())
    far_m = float(distance_transform_edt(~measured)[gaps].max()) * spacing_m
    missing = f"{label} has no heights for {_format_pct(share)} % of field '{field.name}' (up to {far_m:.0f} m away)"
    if share > MAX_FILLED_SHARE or far_m > max(MAX_FILLED_M, 2.0 * spacing_m):
        raise ElevationError(
            f"{missing}; at most {100.0 * MAX_FILLED_SHARE:.0f} % and {MAX_FILLED_M:.0f} m are filled in, so give "
            "heights of the whole field."
        )
    return [f"{missing}; they are continued from those around."] if share > MIN_REPORTED_SHARE else []


def check_height_range(heights: Floats, label: str) -> None:
    """Refuse heights that are on no farm, single ones aside; raises ElevationError."""
    known = heights[np.isfinite(heights)]
    if not len(known):
        return
    low_m, high_m = np.quantile(known, [MAX_SPIKE_SHARE, 1.0 - MAX_SPIKE_SHARE]).tolist()
    if low_m < LOWEST_M or high_m > HIGHEST_M:
        raise ElevationError(
            f"Heights of {label} reach from {low_m:.6g} to {high_m:.6g} m; farmland lies from {LOWEST_M:.0f} to "
            f"{HIGHEST_M:.0f} m, so convert them to metres, or mark what is no height as no data."
        )


def describe_spikes(deviations_m: Floats, name_place: Callable[[int], str], total: int, label: str) -> list[str]:
    """A remark on heights taken out, given how far they are off and where each is, by its number.

    Raises ElevationError where too many of the `total` heights are off.
    """
    if not len(deviations_m):
        return []
    worst = int(np.argmax(np.abs(deviations_m)))
    side, is_one = "above" if deviations_m[worst] > 0.0 else "below", len(deviations_m) == 1
    off = f"{abs(deviations_m[worst]):.3g} m {side} those around at {name_place(worst)}"
    found = (
        f"1 height of {label} is {off}"
        if is_one
        else f"{len(deviations_m)} heights of {label} are spikes, the largest {off}"
    )
    if len(deviations_m) > max(1.0, MAX_SPIKE_SHARE * total):
        raise ElevationError(
            f"{found}; at most {100.0 * MAX_SPIKE_SHARE:.0f} % of the heights are left out as spikes, so clean them."
        )
    return [f"{found}; it is left out as a spike." if is_one else f"{found}; they are left out."]


def check_slopes(slopes: Floats, places: Floats, label: str, field: Field) -> list[str]:
    """A remark on banks steeper than any worked ground, by slopes (n,) m/m at places (n, 2) of nodes in the field.

    Raises ElevationError where more of the field than banks is so steep.
    """
    is_steep, median = slopes > MAX_SLOPE, float(np.median(slopes))
    if not is_steep.any():
        return _describe_steep_field(median, label, field)
    worst, share = int(np.argmax(slopes)), float(is_steep.mean())
    where = describe_place(field, float(places[worst, 0]), float(places[worst, 1]))
    steepest = f"a slope of {100.0 * slopes[worst]:.0f} % at {where}"
    if share > MAX_STEEP_SHARE:
        raise ElevationError(
            f"{label} gives {steepest} and over {100.0 * MAX_SLOPE:.0f} % on {_format_pct(share)} % of field "
            f"'{field.name}'; no machine works there, so check that heights are in metres (feet look 3.3 times as "
            "steep) and of the bare ground, without trees and buildings."
        )
    return [f"{label} gives {steepest}, as of a bank; {_format_pct(share)} % of the field is steeper than "
            f"{100.0 * MAX_SLOPE:.0f} %.", *_describe_steep_field(median, label, field)]  # fmt: skip


def _describe_steep_field(median: float, label: str, field: Field) -> list[str]:
    """A remark on a field that is steep as a whole, as level ones look with heights in feet."""
    if median <= MAX_USUAL_SLOPE:
        return []
    return [
        f"Half of field '{field.name}' is steeper than {100.0 * median:.0f} % by {label}; if it is not, its heights "
        "are in feet (3.3 times as steep), so convert them to metres."
    ]


def _format_pct(share: float) -> str:
    """A share in percent with two digits."""
    return f"{100.0 * share:.2g}" if share < 0.995 else f"{100.0 * share:.0f}"
