"""A diagnosis as one self-contained page, from the verdict down to what it gains."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from reports import palette
from reports.diagnosis_words import (
    SHOWN_S,
    SMALLEST_VISIBLE,
    exchange_words,
    gain_text,
    ground_words,
    held_out_words,
    is_calibration,
    left_words,
    likely_words,
    ordered,
    plan_words,
    rest_terms,
    rest_words,
    size_words,
    status_words,
    value_text,
    visible_text,
)
from reports.effect_words import capital, label, spelled
from reports.template import rendered
from reports.wording import listed, number
from vehicle.effects import effect
from vehicle.measured.answer.verdict import EQUIVALENT, NOT_VISIBLE, Diagnosis, Finding, ResidualPlot

WIDTH, HEIGHT, LEFT, BOTTOM, TOP = 720.0, 300.0, 64.0, 44.0, 12.0
KINDS = (("Across", "cm", "cross_cm", 1), ("Along", "cm", "along_cm", 1), ("Heading", "deg", "heading_deg", 2))


def diagnosis_page(diagnosis: Diagnosis, hidden: str | None = None) -> str:
    """The page as HTML text; `hidden` is what a demonstration had hidden, in words."""
    return rendered("diagnosis.html.j2", _content(diagnosis, hidden))


def _content(diagnosis: Diagnosis, hidden: str | None) -> dict[str, Any]:
    rest = diagnosis.tractor.rest
    return {
        "headline": spelled(diagnosis.headline),
        "grounds": ground_words(diagnosis),
        "tractor": diagnosis.tractor.name,
        "ground": diagnosis.ground,
        "size": size_words(diagnosis),
        "hidden": hidden,
        "facts": _facts(diagnosis),
        "held_out": held_out_words(diagnosis),
        "errors": _errors(diagnosis),
        "bars": [_bars(diagnosis, *kind) for kind in KINDS if _is_known(diagnosis, kind[2])],
        "guilty": diagnosis.guilty_block,
        "blocks": [(name, f"{b:.2f}", f"{a:.2f}") for name, (b, a) in diagnosis.block_error.items()],
        "curve": None if diagnosis.curve is None else _curve(diagnosis.curve),
        "shown_by": _shown_by(diagnosis),
        "effects": [_effect(one) for one in ordered(diagnosis.findings)],
        "smallest_visible": SMALLEST_VISIBLE,
        "likely": likely_words() if any(is_calibration(one) for one in diagnosis.findings) else None,
        "rest": None if rest is None else {"terms": rest_terms(rest), "words": rest_words(rest)},
        "drive": diagnosis.next_drive,
        "rivals": listed(map(label, diagnosis.next_drive.separates)) if diagnosis.next_drive else "",
        "exchanges": exchange_words(diagnosis),
        "left": left_words(diagnosis),
        "plan": plan_words(diagnosis),
        "notes": [spelled(note) for note in diagnosis.notes],
        "before_colour": palette.TRACTORS[1],
        "after_colour": palette.TRACTORS[0],
    }


def _trio(diagnosis: Diagnosis, horizon: float, key: str) -> tuple[float, float, float]:
    """Error before, after and of noise alone."""
    before, after, floor = (
        float(getattr(errors[horizon], key)) for errors in (diagnosis.before, diagnosis.after, diagnosis.floor)
    )
    return before, after, floor


def _is_known(diagnosis: Diagnosis, key: str) -> bool:
    return any(math.isfinite(_trio(diagnosis, horizon, key)[0]) for horizon in diagnosis.before)


def _facts(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """The errors over one horizon, label and value."""
    if SHOWN_S not in diagnosis.before:
        return []
    found = []
    for name, unit, key, _ in KINDS:
        if _is_known(diagnosis, key):
            before, after, floor = (number(value, 2) for value in _trio(diagnosis, SHOWN_S, key))
            found.append((f"{name}, {unit}, pieces of {SHOWN_S:g} s", f"{before} → {after} (noise {floor})"))
    return found


def _errors(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    return [
        {
            "horizon": f"{horizon:g} s",
            "cells": [number(e, digits) for _, _, key, digits in KINDS for e in _trio(diagnosis, horizon, key)],
        }
        for horizon in diagnosis.before
    ]


def _bars(diagnosis: Diagnosis, name: str, unit: str, key: str, digits: int) -> dict[str, Any]:
    """One kind of error by horizon as shares of the largest."""
    rows = {h: dict(zip(("before", "after", "noise"), _trio(diagnosis, h, key), strict=True)) for h in diagnosis.before}
    known = [value for row in rows.values() for value in row.values() if math.isfinite(value)]
    largest = max(known, default=0.0) or 1.0
    return {
        "name": f"{name}, {unit}",
        "rows": [
            {
                "horizon": f"{h:g} s",
                "bars": [
                    {"name": who, "share": 100.0 * value / largest if math.isfinite(value) else 0.0,
                     "text": number(value, digits)}
                    for who, value in row.items()
                ],
            }
            for h, row in rows.items()
        ],
    }  # fmt: skip


def _effect(one: Finding) -> dict[str, Any]:
    gain = gain_text(one)
    if one.gain_interval:
        low, high = (number(value, 0) for value in one.gain_interval)
        gain += f" ({low} to {high})"
    unseen = one.status == NOT_VISIBLE
    return {
        "id": one.id, "label": label(one.id),
        "kind": one.status, "status": status_words(one),
        "block": one.block, "value": value_text(one), "gain": gain, "visible": visible_text(one),
        "same": ", ".join(map(label, one.equivalent_to)), "regressor": effect(one.id).regressor,
        "drive": effect(one.id).drive if unseen else None,
    }  # fmt: skip


def _shown_by(diagnosis: Diagnosis) -> str:
    """Whose curve is drawn, and what it goes with."""
    alike = [one.id for one in diagnosis.findings if one.status == EQUIVALENT and one.interval]
    names = list(diagnosis.named[:1]) or (alike if len(alike) == 1 else [])
    if names:
        return f"{capital(label(names[0]))} shows with: {effect(names[0]).regressor}."
    return "" if alike or not diagnosis.depends_on else f"No known cause: {diagnosis.depends_on[0]}."


def _curve(curve: ResidualPlot) -> dict[str, Any]:
    """Points, error bars and axes of the curve in drawing coordinates."""
    lows = np.concatenate([curve.before - 2 * curve.before_error, curve.after - 2 * curve.after_error, [0.0]])
    highs = np.concatenate([curve.before + 2 * curve.before_error, curve.after + 2 * curve.after_error, [0.0]])
    low, high = float(lows.min()), float(highs.max())
    pad = 0.06 * max(high - low, 1e-6)
    low, high = low - pad, high + pad
    left, right = float(curve.at.min()), float(curve.at.max())
    if right - left < 1e-6 * max(abs(left), abs(right), 1.0):
        left, right = left - 1.0, right + 1.0

    def x(value: float) -> float:
        return LEFT + (value - left) / (right - left) * (WIDTH - LEFT - 20.0)

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
        "xticks": [(x(value), text) for value, text in ticks(left, right)],
        "yticks": [(y(value), text) for value, text in ticks(low, high)],
    }  # fmt: skip


def ticks(low: float, high: float) -> list[tuple[float, str]]:
    """About five round values of a range (`low` below `high`) with texts that tell them apart."""
    span = high - low
    step = 10.0 ** math.floor(math.log10(span / 4.0))
    step *= min((1.0, 2.0, 2.5, 5.0, 10.0), key=lambda m: abs(span / (m * step) - 5.0))
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    if abs(step * 10**decimals - round(step * 10**decimals)) > 0.1:
        decimals += 1  # a step of two and a half
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [(n * step, number(n * step, decimals)) for n in range(first, last + 1)]
