"""The drive that tells laws of parameters apart, where logs leave several open, or that shows a side not driven to.

Each law is fixed at the amounts that explain the logs: a drive decides where they differ by more than a constant change
of the parameters does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from vehicle.identification.cause_selection.candidate_fit import Projector
from vehicle.identification.cause_selection.selection import CauseSelection
from vehicle.identification.diagnosis.results import Finding, NextDrive
from vehicle.identification.fit.column_products import stack_columns, sum_squares
from vehicle.identification.fit.residual_fit import EffectFit, refine_fit
from vehicle.identification.laws.bases import BY_RUN, OVER_DAY
from vehicle.identification.laws.columns import GAIN, LawColumns
from vehicle.identification.laws.selection import FoundLaw
from vehicle.identification.laws.settle import LawSelection, SettledLaw
from vehicle.identification.laws.sides import find_only_side
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_programmes import (
    DRIVE_PROGRAMMES,
    DriveProgramme,
    find_usual_heading_and_speed,
    simulate_programme,
)
from vehicle.identification.residuals.residual_model import build_residual_model
from vehicle.identification.thresholds import DECISIVE_LOSS
from vehicle.identification.verdict.findings import compute_programme_separation, give_constant_channel_weights
from vehicle.identification.verdict.law_findings import (
    ASYMMETRY,
    STAND_IN_KINDS,
    compute_other_side,
    format_law_id,
    is_gain_of_one_side,
)

# During one drive these stay what they are.
CONSTANT_KINDS = (BY_RUN, OVER_DAY)


def choose_law_drive(law_selection: LawSelection) -> NextDrive | None:
    """Return the shortest decisive drive between a law and the first other law that explains as much; the most telling
    one when none decides, and None without such a law."""
    for law in law_selection.laws:
        competitor = _find_competitor(law, law_selection)
        if competitor is None:
            continue
        names = tuple(
            found.effect_id
            if law.found.effect_id != competitor.effect_id
            else format_law_id(found.effect_id, found.kind)
            for found in (law.found, competitor)
        )
        compute_score = partial(_compute_separation, law_selection, laws=(law.found, competitor))
        return _choose_drive((names[0], names[1]), compute_score)
    return None


def choose_side_drive(selection: CauseSelection, findings: Sequence[Finding]) -> NextDrive | None:
    """Return the shortest drive that shows whether a gain known to one side alone holds to the other; None without
    such a gain."""
    residual_model = selection.residual_model
    side = find_only_side(residual_model.dataset)
    gain = next((finding for finding in findings if is_gain_of_one_side(finding, side)), None)
    if gain is None or gain.value is None or side is None:
        return None
    settings, other = selection.fit.settings, compute_other_side(gain, side)
    pair = {**settings, GAIN: gain.value}, {**settings, **other}
    return _choose_drive(
        (GAIN, ASYMMETRY),
        lambda programme: compute_programme_separation(residual_model, programme, residual_model.rig.tractor, pair,
                                                       (GAIN, GAIN)),
    )  # fmt: skip


def _choose_drive(names: tuple[str, str], compute_score: Callable[[DriveProgramme], float]) -> NextDrive:
    """Return the shortest decisive drive, or the most telling one."""
    scores = [(programme, compute_score(programme)) for programme in DRIVE_PROGRAMMES]
    decisive = [one for one in scores if one[1] > DECISIVE_LOSS]
    programme, score = min(decisive, key=lambda o: o[0].seconds) if decisive else max(scores, key=lambda o: o[1])
    return NextDrive(programme.id, programme.description, programme.seconds, names, score, score > DECISIVE_LOSS)


def _find_competitor(law: SettledLaw, law_selection: LawSelection) -> FoundLaw | None:
    """Return the first other law that explains as much, of those that were scored for a stand-in as well."""
    kinds = [STAND_IN_KINDS[name] for name in law.competitors]
    stand_ins = [
        found
        for found in law_selection.outcome.scores
        if found.effect_id == law.found.effect_id and found.kind in kinds and found.kind != law.found.kind
    ]
    return next(iter((*law.found.alternatives, *stand_ins)), None)


def _compute_separation(
    law_selection: LawSelection, programme: DriveProgramme, laws: tuple[FoundLaw, FoundLaw]
) -> float:
    """Return the loss of one law on the drive that follows the other, with any constant change of the parameters."""
    residual_model = law_selection.selection.residual_model
    heading, pace = find_usual_heading_and_speed(residual_model.dataset.segments)
    settings = law_selection.selection.fit.settings
    simulated = simulate_programme(residual_model.rig, programme, heading, pace, settings)
    rig = replace(residual_model.rig, origin=(0.0, 0.0))
    trial = build_residual_model(simulated, rig, settings, residual_model.noise)
    trial = give_constant_channel_weights(residual_model, trial)
    residuals = trial.compute_residuals(settings)
    parts = law_selection.selection.fit.parts
    fit = refine_fit(trial, EffectFit(parts, residuals, np.zeros((len(residuals), 0))))
    columns = LawColumns(trial, fit)
    constants = [columns.compute_columns(law.score.target, columns.constant)[:, 0] for law in laws]
    changes = [_compute_change(columns, law) for law in laws]
    return sum_squares(Projector(stack_columns(constants, len(residuals)))(changes[0] - changes[1]))


def _compute_change(columns: LawColumns, law: FoundLaw) -> Array:
    """Return what a law changes of the residuals (n,) beyond a constant."""
    if law.kind in CONSTANT_KINDS:
        return np.zeros(5 * columns.residual_model.dataset.rows)
    return np.asarray(columns.compute_columns(law.score.target, law.score.basis) @ law.score.amounts)
