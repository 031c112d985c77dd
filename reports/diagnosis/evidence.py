"""What convinces of a diagnosis, drawn: paths to play; errors over time, speed, angle and place; the remaining error
against what it depends on; correlations."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np

from fields.arrays import Floats
from reports.common.drawing_sizes import BAR_FRAME, CURVE_FRAME, EDGE_SHARE
from reports.common.rendering import make_json_safe
from reports.common.wording import format_number, get_effect_label
from vehicle.identification.diagnosis.results import (
    Diagnosis,
    ParameterCorrelations,
    PieceErrors,
    PlaceErrors,
    ReplayEvidence,
    ResidualPlot,
)

BAR_GAP_SHARE = 0.1  # of a bin, at both sides of its two bars
SHADE_QUANTILE = 0.95  # of the errors before, and of slopes: a single bad square would leave all others pale
MIN_SPLIT_SQUARES = 4  # fewer say nothing of steep ground and of the rest
STRONG_CORRELATION = 0.9  # above it one value can nearly take the place of another


def build_evidence_content(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """What the page shows of the replayed logs; None where they were not replayed."""
    evidence = diagnosis.evidence
    if evidence is None or len(evidence.over_time.rows) == 0:
        return None
    quantities = [
        ("over driving time", "driving time, min", evidence.over_time, 1.0 / 60.0),
        ("by speed", "speed, m/s", evidence.by_speed, 1.0),
        ("by wheel angle", "wheel angle, degrees, right positive", evidence.by_angle, 1.0),
    ]
    kinds = ["cross", "along"] if diagnosis.along_judged else ["cross"]
    return {
        "is_unchanged": all(np.array_equal(path.before_m, path.after_m) for path in evidence.paths),
        "piece_s": f"{evidence.piece_s:g}",
        "charts": [
            _draw_bins(kind, title, axis, bins, unit)
            for kind in kinds
            for title, axis, bins, unit in quantities
            if len(bins.rows)  # short logs may have too few rows in every bin
        ],
        "maps": _draw_places(evidence.by_place),
        "paths": _draw_paths(evidence),
    }


def build_residuals_dict(evidence: ReplayEvidence) -> dict[str, Any]:
    """The errors of the replayed logs as plain values: an entry per bin."""

    def list_bins(bins: PieceErrors) -> list[dict[str, float]]:
        columns = {name.removesuffix("s"): getattr(bins, name) for name in ("lows", "highs")}
        columns |= {name: getattr(bins, name) for name in PieceErrors.__annotations__ if name not in ("lows", "highs")}
        return [dict(zip(columns, map(float, values), strict=True)) for values in zip(*columns.values(), strict=True)]

    places = evidence.by_place
    return {
        "piece_s": evidence.piece_s,
        "over_time_s": list_bins(evidence.over_time),
        "by_speed_mps": list_bins(evidence.by_speed),
        "by_angle_deg": list_bins(evidence.by_angle),
        "by_place_m": [
            {"west": float(west), "south": float(south), "side": places.side_m, "before_cm": float(before),
             "after_cm": float(after)}
            | ({} if places.slopes is None else {"slope_pct": 100.0 * float(places.slopes[number])})
            for number, (west, south, before, after) in enumerate(
                zip(places.west_m, places.south_m, places.before_cm, places.after_cm, strict=True)
            )
        ],
    }  # fmt: skip


def list_correlations(correlations: ParameterCorrelations | None) -> list[dict[str, Any]]:
    """Every pair of fitted values with its correlation, the strongest first."""
    if correlations is None:
        return []
    pairs = [
        {
            "values": [".".join(correlations.names[first]), ".".join(correlations.names[second])],
            "correlation": float(correlations.matrix[first, second]),
        }
        for first, second in combinations(range(len(correlations.names)), 2)
    ]
    return sorted(pairs, key=lambda pair: -abs(pair["correlation"]))


def build_correlation_table(correlations: ParameterCorrelations | None) -> dict[str, Any] | None:
    """The matrix of correlations with its names; None without two values."""
    if correlations is None:
        return None
    ids = [effect for effect, _ in correlations.names]
    names = [
        get_effect_label(effect)
        if ids.count(effect) == 1
        else f"{get_effect_label(effect)}, {parameter.rpartition('_')[0] or parameter}"
        for effect, parameter in correlations.names
    ]
    rows = [
        {
            "name": name,
            "cells": [
                {"text": format_number(float(value), 2), "share": f"{abs(float(value)):.2f}"}
                for value in correlations.matrix[number, : number + 1]
            ],
        }
        for number, name in enumerate(names)
    ]
    strong = [
        f"{names[first]} and {names[second]}"
        for first, second in combinations(range(len(names)), 2)
        if abs(correlations.matrix[first, second]) > STRONG_CORRELATION
    ]
    return {"names": names, "rows": rows, "strong": strong}


def _draw_bins(kind: str, title: str, axis: str, bins: PieceErrors, unit: float) -> dict[str, Any]:
    """Two bars per bin, before and after, in drawing coordinates."""
    before, after = (getattr(bins, f"{kind}_{when}_cm") for when in ("before", "after"))
    lows, highs = unit * bins.lows, unit * bins.highs
    top = 1.05 * max(float(np.nanmax([before, after])), 1e-6)
    x_axis, y_axis = BAR_FRAME.build_axes((float(lows.min()), float(highs.max())), (0.0, top))
    bars = []
    for number in range(len(lows)):
        left, right = x_axis.place(float(lows[number])), x_axis.place(float(highs[number]))
        width = (right - left) * (1.0 - 2.0 * BAR_GAP_SHARE) / 2.0
        for place, (name, values) in enumerate((("before", before), ("after", after))):
            y = y_axis.place(float(values[number]))
            bars.append(
                {
                    "name": name,
                    "x": f"{left + (right - left) * BAR_GAP_SHARE + place * width:.1f}",
                    "y": y,
                    "width": f"{width:.1f}",
                    "height": f"{BAR_FRAME.bottom - y:.1f}",
                    "value": f"{float(values[number]):.3f}",
                    "words": (
                        f"{format_number(float(lows[number]), 2)} to {format_number(float(highs[number]), 2)}: "
                        f"{format_number(float(values[number]), 1)} cm {name}"
                    ),
                }
            )
    return {
        "kind": kind,
        "title": f"{'Across' if kind == 'cross' else 'Along'} the path, {title}",
        "axis": axis,
        "frame": BAR_FRAME,
        "bars": bars,
        "xticks": x_axis.list_ticks(),
        "yticks": y_axis.list_ticks(),
    }


def _draw_places(places: PlaceErrors) -> dict[str, Any]:
    """Squares of a map, shaded by their error, before and after on one scale, and by slope where heights are known."""
    largest = max(float(np.quantile(places.before_cm, SHADE_QUANTILE)), 1e-6)
    width, height = (float(np.ptp(edge)) + places.side_m for edge in (places.west_m, places.south_m))
    slopes = None
    if places.slopes is not None:
        steepest = max(float(np.quantile(places.slopes, SHADE_QUANTILE)), 1e-6)
        words = [f"slope {format_number(100.0 * float(slope), 1)} %" for slope in places.slopes]
        squares = _shade_squares(places, places.slopes / steepest, words)
        slopes = {"squares": squares, "largest": format_number(100.0 * steepest, 1)}
    return {
        "width": f"{width:g}",
        "height": f"{height:g}",
        "side": f"{places.side_m:g}",
        "squares": {
            name: _shade_squares(
                places, values / largest, [f"{format_number(float(error), 1)} cm {name}" for error in values]
            )
            for name, values in (("before", places.before_cm), ("after", places.after_cm))
        },
        "largest": format_number(largest, 1),
        "slopes": slopes,
        "slope_share": describe_error_on_slopes(places),
    }


def _shade_squares(places: PlaceErrors, shades: Floats, words: Sequence[str]) -> list[dict[str, str]]:
    """The squares of a map with their words; a shade of 1 or more is the darkest."""
    left, top = float(places.west_m.min()), float(places.south_m.max())
    return [
        {"x": f"{west - left:g}", "y": f"{top - south:g}", "shade": f"{min(shade, 1.0):.2f}", "words": text}
        for west, south, shade, text in zip(places.west_m, places.south_m, shades, words, strict=True)
    ]


def describe_error_on_slopes(places: PlaceErrors) -> str:
    """The error on the steeper half of the squares and on the others, before and after; "" without heights."""
    if places.slopes is None or len(places.slopes) < MIN_SPLIT_SQUARES or np.ptp(places.slopes) == 0.0:
        return ""
    limit = float(np.median(places.slopes))
    steep = places.slopes > limit
    errors = [
        format_number(float(np.sqrt((values[part] ** 2).mean())), 1)
        for part in (steep, ~steep)
        for values in (places.before_cm, places.after_cm)
    ]
    return (
        f"On squares steeper than {format_number(100.0 * limit, 1)} % the error is {errors[0]} cm before and "
        f"{errors[1]} cm after, on the others {errors[2]} cm and {errors[3]} cm."
    )


def _draw_paths(evidence: ReplayEvidence) -> dict[str, Any] | None:
    """Paths as numbers for the page's script, and which of them gains most."""
    if not evidence.paths:
        return None
    names, gains_m, paths = ("measured", "before", "after"), [], []
    for path in evidence.paths:
        measured, before, after = lines = [getattr(path, f"{name}_m") for name in names]
        before_off_m, after_off_m = (float(np.mean(np.linalg.norm(one - measured, axis=1))) for one in (before, after))
        gains_m.append(before_off_m - after_off_m)
        finite = np.concatenate(lines)
        low, high = np.nanmin(finite, axis=0), np.nanmax(finite, axis=0)
        margin = EDGE_SHARE * max(float((high - low).max()), 1.0)
        drawn = [np.column_stack([line[:, 0] - low[0], high[1] - line[:, 1]]) for line in lines]
        paths.append(
            {
                "name": path.name,
                "time_s": make_json_safe(path.time_s - path.time_s[0], 2),
                **{name: make_json_safe(line, 2) for name, line in zip(names, drawn, strict=True)},
                "box": " ".join(f"{value:.2f}" for value in (-margin, -margin, *(high - low + 2.0 * margin))),
            }
        )
    shown = int(np.argmax(gains_m))
    texts = {name: " ".join(f"{x},{y}" for x, y in paths[shown][name]) for name in names}
    return {"shown": shown, "paths": paths, "box": paths[shown]["box"], "lines": texts}


def build_curve_drawing(curve: ResidualPlot) -> dict[str, Any]:
    """Points, error bars and axes of the curve in drawing coordinates."""
    lows = np.concatenate([curve.before - 2 * curve.before_error, curve.after - 2 * curve.after_error, [0.0]])
    highs = np.concatenate([curve.before + 2 * curve.before_error, curve.after + 2 * curve.after_error, [0.0]])
    low, high = float(lows.min()), float(highs.max())
    pad = 0.06 * max(high - low, 1e-6)
    low, high = low - pad, high + pad
    lowest_at, highest_at = float(curve.regressor_values.min()), float(curve.regressor_values.max())
    limits = [] if curve.limit is None else [-curve.limit, curve.limit]
    limits = limits if lowest_at < 0.0 else limits[1:]  # of the sides that were driven to
    lowest_at, highest_at = min(lowest_at, *limits, highest_at), max(highest_at, *limits, lowest_at)
    if highest_at - lowest_at < 1e-6 * max(abs(lowest_at), abs(highest_at), 1.0):
        lowest_at, highest_at = lowest_at - 1.0, highest_at + 1.0
    x_axis, y_axis = CURVE_FRAME.build_axes((lowest_at, highest_at), (low, high))
    series = []
    for name, values, errors in (
        ("before", curve.before, curve.before_error),
        ("after", curve.after, curve.after_error),
    ):
        points = [
            {
                "x": x_axis.place(float(at)),
                "y": y_axis.place(float(v)),
                "top": y_axis.place(float(v + 2 * e)),
                "low": y_axis.place(float(v - 2 * e)),
            }
            for at, v, e in zip(curve.regressor_values, values, errors, strict=True)
        ]
        series.append({"name": name, "points": points, "line": " ".join(f"{p['x']},{p['y']}" for p in points)})
    return {
        "frame": CURVE_FRAME,
        "zero": y_axis.place(0.0),
        "series": series,
        "regressor": curve.regressor,
        "quantity": curve.quantity,
        "limits": [(x_axis.place(value), format_number(abs(value), 2)) for value in limits],
        "xticks": x_axis.list_ticks(),
        "yticks": y_axis.list_ticks(),
    }
