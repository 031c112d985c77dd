"""A diagnosis as one self-contained page, from the verdict down to what it gains."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

import numpy as np

from reports import palette
from reports.diagnosis_table import remarks, value_text, visible_text
from vehicle.measured.verdict import Curve, Diagnosis, Errors, Finding

WIDTH, HEIGHT, LEFT, BOTTOM, TOP = 720.0, 300.0, 64.0, 44.0, 12.0
ORDER = ("named", "equivalent", "refuted", "not-visible")


def diagnosis_page(diagnosis: Diagnosis, hidden: str | None = None) -> str:
    """The page as HTML text; `hidden` is what a demonstration had hidden, in words."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    source = files("reports").joinpath("diagnosis.html.j2").read_text(encoding="utf-8")
    return environment.from_string(source).render(_content(diagnosis, hidden)).rstrip() + "\n"


def _content(diagnosis: Diagnosis, hidden: str | None) -> dict[str, Any]:
    return {
        "headline": diagnosis.headline,
        "tractor": diagnosis.tractor.name,
        "ground": diagnosis.ground,
        "runs": len(diagnosis.names),
        "minutes": f"{diagnosis.minutes:.1f}",
        "used": diagnosis.rows_used,
        "gated": diagnosis.rows_gated,
        "hidden": hidden,
        "facts": _facts(diagnosis),
        "errors": _errors(diagnosis),
        "bars": _bars(diagnosis.before, diagnosis.after, diagnosis.floor),
        "guilty": diagnosis.guilty_block,
        "blocks": [(name, f"{b:.2f}", f"{a:.2f}") for name, (b, a) in diagnosis.block_error.items()],
        "curve": None if diagnosis.curve is None else _curve(diagnosis.curve),
        "effects": [_effect(one) for one in sorted(diagnosis.findings, key=lambda o: ORDER.index(o.status))],
        "drive": diagnosis.next_drive,
        "exchanges": [f"{one.id}: {one.exchange}." for one in diagnosis.findings if one.exchange and one.interval],
        "unexplained": f"{100.0 * diagnosis.unexplained_share:.0f}",
        "depends": diagnosis.depends_on,
        "calibration": _calibration(diagnosis),
        "plan": diagnosis.plan,
        "notes": diagnosis.notes,
        "remarks": remarks(diagnosis),
        "before_colour": palette.TRACTORS[1],
        "after_colour": palette.TRACTORS[0],
    }


def _facts(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    if 5.0 not in diagnosis.before:
        return []
    pairs = [
        (name, *(getattr(errors[5.0], key) for errors in (diagnosis.before, diagnosis.after, diagnosis.floor)))
        for name, key in (("Across, cm", "cross_cm"), ("Along, cm", "along_cm"), ("Heading, deg", "heading_deg"))
    ]
    return [(f"{name} after 5 s", f"{b:.2f} → {a:.2f} (noise {f:.2f})") for name, b, a, f in pairs]


def _errors(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    rows = []
    for horizon, before in diagnosis.before.items():
        trio = (before, diagnosis.after[horizon], diagnosis.floor[horizon])
        cells = [f"{getattr(e, key):.{digits}f}" for key, digits in
                 (("cross_cm", 1), ("along_cm", 1), ("heading_deg", 2)) for e in trio]  # fmt: skip
        rows.append({"horizon": f"{horizon:g} s", "cells": cells})
    return rows


def _bars(before: Errors, after: Errors, floor: Errors) -> list[dict[str, Any]]:
    """Error across by horizon as shares of the largest."""
    largest = max((e.cross_cm for errors in (before, after, floor) for e in errors.values()), default=1.0) or 1.0
    return [
        {
            "horizon": f"{h:g} s",
            "bars": [
                {"name": name, "share": 100.0 * errors[h].cross_cm / largest, "text": f"{errors[h].cross_cm:.1f} cm"}
                for name, errors in (("before", before), ("after", after), ("noise", floor))
            ],
        }
        for h in before
    ]


def _effect(one: Finding) -> dict[str, Any]:
    gain = f"{one.gain_pct:.0f}" if one.interval else ""
    if one.gain_interval:
        gain += f" ({one.gain_interval[0]:.0f} to {one.gain_interval[1]:.0f})"
    return {
        "id": one.id, "status": one.status, "block": one.block, "value": value_text(one), "gain": gain,
        "visible": visible_text(one), "same": ", ".join(one.equivalent_to),
    }  # fmt: skip


def _calibration(diagnosis: Diagnosis) -> list[str]:
    return [
        f"{name}: {', '.join(f'{key} {value:.3g}' for key, value in values.items())}"
        for name, values in diagnosis.calibration.items()
    ]


def _curve(curve: Curve) -> dict[str, Any]:
    """Points, error bars and axes of the curve in drawing coordinates."""
    lows = np.concatenate([curve.before - 2 * curve.before_error, curve.after - 2 * curve.after_error, [0.0]])
    highs = np.concatenate([curve.before + 2 * curve.before_error, curve.after + 2 * curve.after_error, [0.0]])
    low, high = float(lows.min()), float(highs.max())
    pad = 0.06 * max(high - low, 1e-6)
    low, high = low - pad, high + pad
    left, right = float(curve.at.min()), float(curve.at.max())
    span = max(right - left, 1e-9)

    def x(value: float) -> float:
        return LEFT + (value - left) / span * (WIDTH - LEFT - 20.0)

    def y(value: float) -> float:
        return TOP + (high - value) / (high - low) * (HEIGHT - TOP - BOTTOM)

    series = []
    for name, values, errors in (
        ("before", curve.before, curve.before_error), ("after", curve.after, curve.after_error)
    ):  # fmt: skip
        points = [
            {"x": x(float(at)), "y": y(float(v)), "top": y(float(v + 2 * e)), "low": y(float(v - 2 * e))}
            for at, v, e in zip(curve.at, values, errors, strict=True)
        ]
        series.append({"name": name, "points": points, "line": " ".join(f"{p['x']:.1f},{p['y']:.1f}" for p in points)})
    return {
        "width": WIDTH, "height": HEIGHT, "zero": y(0.0), "left": LEFT, "right": WIDTH - 20.0,
        "bottom": HEIGHT - BOTTOM,
        "series": series, "regressor": curve.regressor, "quantity": curve.quantity,
        "xticks": [(x(t), f"{t:.3g}") for t in _ticks(left, right)],
        "yticks": [(y(t), f"{t:.3g}") for t in _ticks(low, high)],
    }  # fmt: skip


def _ticks(low: float, high: float) -> list[float]:
    """About five round values."""
    span = max(high - low, 1e-9)
    step = 10.0 ** np.floor(np.log10(span / 4.0))
    step *= min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(span / (m * step) - 5.0))
    return [float(round(t, 10)) for t in np.arange(np.ceil(low / step) * step, high + 1e-9, step)]
