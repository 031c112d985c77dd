"""The tractor file that a diagnosis writes: effects with intervals and the logs they came from, and the discrepancy
model of laws that have no name."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from vehicle.identification.diagnosis.results import EQUIVALENT, NAMED, Finding
from vehicle.identification.diagnosis.values import ValueConverter
from vehicle.identification.diagnosis.verdicts import Verdict
from vehicle.identification.replay.drive_segments import DriveDataset
from vehicle.model.effect_kinds import INTERVAL_SIGMAS, Interval
from vehicle.model.effects import DISCREPANCY_KEY
from vehicle.model.tractor import DiscrepancyModel, EffectSetting, Tractor

FILE_DIGITS = 6  # significant digits of a value in a file: far finer than any interval
TRUSTED_SHARE = 0.005  # of the driving at either end of speeds and angles in which a discrepancy model is not trusted


def build_extended_tractor(
    converter: ValueConverter, tractor: Tractor, ground: str, saved: Sequence[Verdict], findings: Sequence[Finding]
) -> Tractor:
    """The tractor with what is saved. Effects of the file that these logs cannot show stay as they are."""
    by_id = {finding.id: finding for finding in findings}
    unseen = {finding.id for finding in findings if finding.value is None and finding.smallest_visible is None}
    effects = {name: setting for name, setting in tractor.effects.items() if name in unseen}
    dataset = converter.problem.data.dataset
    settings = converter.build_settings([(one.hypothesis, one.amounts) for one in saved])
    for name, values in settings.items():
        if name == DISCREPANCY_KEY or name not in by_id:
            continue
        finding = by_id[name]
        effects[name] = EffectSetting(
            value={key: round_value(number) for key, number in values.items()},
            interval={key: (round_value(low), round_value(high)) for key, (low, high) in
                      (finding.interval or {}).items() if math.isfinite(low) and math.isfinite(high)},
            named=finding.status == NAMED,
            equivalent_to=finding.equivalent_to if finding.status == EQUIVALENT else (),
            ground=ground,
            logs=dataset.names,
        )  # fmt: skip
    amounts = settings.get(DISCREPANCY_KEY, {})
    discrepancy = _build_discrepancy(dataset, amounts, _list_spreads(converter, saved)) if amounts else None
    kept = tractor.discrepancy_model if discrepancy is None and not saved else discrepancy
    return tractor.model_copy(update={"effects": effects, "discrepancy_model": kept})


def round_value(value: float) -> float:
    """Round a value to the digits that a file needs."""
    return float(f"{value:.{FILE_DIGITS}g}")


def _list_spreads(converter: ValueConverter, saved: Sequence[Verdict]) -> dict[str, Interval]:
    """95 % intervals of the amounts of a discrepancy model."""
    spreads: dict[str, Interval] = {}
    for verdict in saved:
        sigmas = np.sqrt(np.maximum(np.diag(verdict.covariance), 0.0))
        ends = [
            converter.build_settings([(verdict.hypothesis, verdict.amounts + sign * INTERVAL_SIGMAS * sigmas)])
            for sign in (-1.0, 1.0)
        ]
        if verdict.hypothesis.terms:
            low, high = (one[DISCREPANCY_KEY] for one in ends)
            spreads |= {name: (min(low[name], high[name]), max(low[name], high[name])) for name in low}
    return spreads


def _build_discrepancy(
    dataset: DriveDataset, amounts: Mapping[str, float], intervals: Mapping[str, Interval]
) -> DiscrepancyModel:
    """The discrepancy model, trusted where nearly all of the driving was."""
    speeds = np.concatenate([segment.speed_in_gear for segment in dataset.segments])
    angles = [segment.wheel if segment.wheel is not None else segment.command for segment in dataset.segments]
    degrees = np.degrees(np.concatenate([one for one in angles if one is not None]))
    fast = float(np.quantile(speeds, 1.0 - TRUSTED_SHARE))
    low, high = (float(np.quantile(degrees, share)) for share in (TRUSTED_SHARE, 1.0 - TRUSTED_SHARE))
    slow = min(float(np.quantile(speeds, TRUSTED_SHARE)), 0.9 * fast)
    if high - low < 1.0:
        low, high = low - 0.5, high + 0.5
    return DiscrepancyModel(
        amounts={name: round_value(amount) for name, amount in amounts.items()},
        speed_mps=(round_value(max(slow, 0.0)), round_value(max(fast, 0.01))),
        angle_deg=(round_value(low), round_value(high)),
        interval={name: (round_value(first), round_value(last)) for name, (first, last) in intervals.items()},
        logs=dataset.names,
    )
