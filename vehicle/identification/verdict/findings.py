"""Findings per effect (status, value, gain, smallest visible size), alternatives that only a heading separates, and the
next drive.

Without a heading, an antenna further back and late positions or steering look alike: each makes the positions turn
later than the commands. The next drive is chosen from a small library: it is simulated with each competing effect at
the value that explains the logs, and decides when the other effect, refitted, stays clearly wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vehicle.identification.cause_selection.candidate_fit import Projector, fit_candidate
from vehicle.identification.diagnosis.results import (
    EQUIVALENT,
    LIKELY,
    NAMED,
    NOT_VISIBLE,
    REFUTED,
    Finding,
    NextDrive,
    convert_nonfinite_to_none,
)
from vehicle.identification.fit.column_products import sum_squares
from vehicle.identification.fit.effect_parameters import (
    EffectParameters,
    build_parameters,
    collect_settings,
    find_finest_size,
    get_shown_blocks,
)
from vehicle.identification.fit.open_loop import ModelTerm
from vehicle.identification.fit.residual_fit import EffectFit
from vehicle.identification.logs.schema import Array
from vehicle.identification.model_extension.tractor_extension import compute_shared_error
from vehicle.identification.replay.drive_programmes import (
    DRIVE_PROGRAMMES,
    DriveProgramme,
    find_usual_heading_and_speed,
    simulate_programme,
)
from vehicle.identification.residuals.noise_weights import ResidualChannel
from vehicle.identification.residuals.residual_model import ResidualModel, build_residual_model
from vehicle.identification.thresholds import DECISIVE_LOSS, LEAST_GAIN, ONE_SPEED_SPREAD, SURELY_SHOWN_FACTOR
from vehicle.identification.verdict.held_out_case import DiagnosisCase
from vehicle.model.effect_kinds import INTERVAL_SIGMAS, Interval
from vehicle.model.effects import CATALOGUE, Effect, get_effect, get_neutral_values
from vehicle.model.tractor import Tractor

LATE_EFFECTS = ("antenna_forward", "gnss_latency", "steering_dead_time")
ONE_SPEED_EFFECTS = ("antenna_forward", "position_delay")
MOVING_SHARE = 0.3  # chosen, of the median speed: less is a start or a stop
EffectValues = dict[str, float]


def list_delay_like_effects(residual_model: ResidualModel) -> tuple[str, ...]:
    """Return the effects that these logs cannot separate: without a heading (the last one without a wheel angle), or
    at one speed."""
    if all(segment.heading_measured for segment in residual_model.dataset.segments):
        return ONE_SPEED_EFFECTS if is_at_one_speed(residual_model) else ()
    return LATE_EFFECTS[:2] if residual_model.has_measured_wheel_angle else LATE_EFFECTS


def is_at_one_speed(residual_model: ResidualModel) -> bool:
    """Whether the tractor moves at nearly the same speed in all rows, apart from starts and stops."""
    speed = np.concatenate([segment.speed_in_gear for segment in residual_model.dataset.segments])
    moving = speed[speed > MOVING_SHARE * float(np.median(speed))]
    low, middle, high = np.quantile(moving, (0.1, 0.5, 0.9)) if moving.size else (0.0, 0.0, 0.0)
    return bool(high - low < ONE_SPEED_SPREAD * middle)


def add_delay_like_competitors(
    residual_model: ResidualModel,
    competitors: Mapping[str, Mapping[str, EffectValues]],
    found_values: Mapping[str, EffectValues],
    taken_ids: Collection[str],
) -> dict[str, dict[str, EffectValues]]:
    """Add, for names among the late effects, the others at the values that would delay positions as much.

    Effects in `model_ids` are part of the model and no alternatives.
    """
    _, pace = find_usual_heading_and_speed(residual_model.dataset.segments)
    late_effects, competitors_by_name = (
        list_delay_like_effects(residual_model),
        {name: dict(late_competitors) for name, late_competitors in competitors.items()},
    )
    for name in competitors_by_name:
        late_m = _compute_delay_m(name, found_values[name], pace) if name in late_effects else 0.0
        if late_m > 0.0:
            late_competitors = {
                late_effect: _convert_delay_to_values(late_effect, late_m, pace)
                for late_effect in late_effects
                if late_effect != name and late_effect not in taken_ids
            }
            competitors_by_name[name] = {**late_competitors, **competitors_by_name[name]}
    return competitors_by_name


def _compute_delay_m(name: str, values: EffectValues, pace: float) -> float:
    """Return how far (m) behind its true position an effect puts the measured one."""
    return -values["distance_m"] if name == "antenna_forward" else values["time_s"] * pace


def _convert_delay_to_values(name: str, late_m: float, pace: float) -> EffectValues:
    return {"distance_m": -late_m} if name == "antenna_forward" else {"time_s": late_m / pace}


# Of the typical size: a small trial is nearly linear, a large one shows a dead band.
TRIAL_SIZE_SHARES = 0.3, 1.0, 2.0
CompetitorsByName = Mapping[str, Mapping[str, dict[str, float]]]


def build_findings(
    case: DiagnosisCase, names: Sequence[str], competitors: CompetitorsByName, step: Callable[[], None]
) -> list[Finding]:
    """Return a finding for every effect; `competitors` are the alternatives to the names."""
    name_by_competitor = {
        competitor: name for name, competitors_of_name in competitors.items() for competitor in competitors_of_name
    }
    built_findings = []
    for entry in CATALOGUE:
        step()
        if entry.id in names:
            built_findings.append(
                _build_modelled_finding(case, entry, EQUIVALENT if competitors.get(entry.id) else NAMED, competitors)
            )
        elif entry.id in case.extension.term_ids:
            built_findings.append(_build_modelled_finding(case, entry, LIKELY, {}))
        elif entry.id in name_by_competitor:
            built_findings.append(_build_alternative_finding(case, entry, name_by_competitor[entry.id], competitors))
        else:
            built_findings.append(_build_absent_finding(case, entry))
    return built_findings


def _build_modelled_finding(case: DiagnosisCase, entry: Effect, status: str, competitors: CompetitorsByName) -> Finding:
    gain, interval = case.compute_held_out_gain(entry.id)
    value = case.main_terms[entry.id].value
    competitors_of_name = competitors.get(entry.id, {})
    exchange = "; ".join(
        f"{format_size(entry, value)} looks like {format_size(get_effect(competitor), values)} of {competitor}"
        for competitor, values in competitors_of_name.items()
    )
    intervals = dict(case.extension.intervals[entry.id])
    if status == EQUIVALENT:
        intervals[entry.size.name] = extend_to_neutral(case.tractor, entry, intervals[entry.size.name])
    return Finding(
        entry.id,
        status,
        value,
        intervals,
        gain,
        interval,
        find_smallest_visible(case, entry),
        entry.size.unit,
        entry.block,
        entry.describe(value),
        tuple(competitors_of_name),
        exchange,
    )


def extend_to_neutral(tractor: Tractor, entry: Effect, interval: Interval) -> Interval:
    """Extend the interval of a cause that an alternative could replace completely: it reaches to neutral."""
    neutral_size = get_neutral_values(entry.id, tractor.steering)[entry.size.name]
    return min(interval[0], neutral_size), max(interval[1], neutral_size)


def format_size(entry: Effect, value: Mapping[str, float]) -> str:
    """Format the size of an effect with its unit."""
    return f"{value[entry.size.name]:.3g} {entry.size.unit}".strip()


def _build_alternative_finding(
    case: DiagnosisCase, entry: Effect, name: str, competitors: CompetitorsByName
) -> Finding:
    """Describe an effect that would explain as much as one in the model."""
    value = competitors[name][entry.id]
    equivalent_to = (name, *[competitor for competitor in competitors[name] if competitor != entry.id])
    modelled_value = case.main_terms[name].value
    return Finding(
        entry.id,
        EQUIVALENT,
        value,
        None,
        None,
        None,
        find_smallest_visible(case, entry),
        entry.size.unit,
        entry.block,
        entry.describe(value),
        equivalent_to,
        f"looks like {format_size(get_effect(name), modelled_value)} of {name}",
    )


def _build_absent_finding(case: DiagnosisCase, entry: Effect) -> Finding:
    """Describe an effect that is not in the model: refuted when its usual size would have shown."""
    smallest = find_smallest_visible(case, entry)
    typical = entry.size.scale_to_wheelbase(case.tractor.wheelbase_m).typical
    is_finer = smallest is not None and entry.kind.is_no_larger_fault(smallest, typical)
    # An effect that the residuals support, or that needs a heading, is not refuted even if it does not lower the error.
    is_unsure = entry.id in list_delay_like_effects(case.residual_model) or _is_supported(case, entry)
    status = REFUTED if is_finer and not is_unsure else NOT_VISIBLE
    return Finding(entry.id, status, None, None, None, None, smallest, entry.size.unit, entry.block, "")


def _is_supported(case: DiagnosisCase, entry: Effect) -> bool:
    """Whether the residuals support the effect, beyond its tolerance."""
    if entry.id in case.refused_effects:
        return True
    tractor, row_s = case.tractor, case.residual_model.get_interval_s(entry.id)
    sizes = [
        parameters.compute_deviation(coordinates)
        for parameters, coordinates in case.fit.parts
        if parameters.id == entry.id
    ]
    extra = case.fit.linear_terms
    if not sizes and extra is not None and extra.amounts[extra.term_columns].size and not entry.kind.is_searched:
        # Covariates may have taken up what an effect explains, so it is tested without them.
        parameters = build_parameters(tractor, entry.id, case.residual_model.dataset.effect_places)
        candidate = fit_candidate(
            case.residual_model.compute_changes,
            case.fit_without_terms,
            parameters,
            Projector(case.fit_without_terms.jacobian),
        )
        sizes = [candidate.parameters.compute_deviation(candidate.coordinates)] if candidate.gain > LEAST_GAIN else []
    return any(size > find_finest_size(tractor, entry.id, row_s) for size in sizes)


def find_smallest_visible(case: DiagnosisCase, entry: Effect) -> float | None:
    """Return the smallest size, in the unit of the effect, that would exceed chance, tolerance and remaining error."""
    residual_model, fit, tractor = case.residual_model, case.fit, case.tractor
    parts = [part for part in fit.parts if part[0].id != entry.id]
    bare_residuals, projector = (
        case.compute_residuals_without(entry.id) if entry.id in fit.settings else case.fitted_residuals
    )
    places = residual_model.dataset.effect_places
    parameters = build_parameters(
        tractor,
        entry.id,
        {**places, entry.id: _find_middle_circle(residual_model)} if entry.kind.is_searched else places,
    )
    for share in TRIAL_SIZE_SHARES:
        coordinates = parameters.clip(np.array(parameters.neutral) + share * np.array(parameters.typical))
        trace = projector(
            residual_model.compute_change(
                collect_settings([*parts, (parameters, coordinates)]), bare_residuals, get_shown_blocks(entry.id)
            )
            - bare_residuals
        )
        strength = sum_squares(trace)
        if strength > SURELY_SHOWN_FACTOR * LEAST_GAIN * case.remaining_misfit:
            trial = _Trial(parameters, coordinates, share, strength / case.remaining_misfit)
            return _compute_visible_size(case, trial, -float(trace @ bare_residuals) / strength)
    return None


@dataclass(frozen=True, eq=False)
class _Trial:
    """An effect at coordinates that are a `share` of its typical size, and how strongly it shows (loss)."""

    parameters: EffectParameters
    coordinates: Array
    share: float
    strength: float


def _compute_visible_size(case: DiagnosisCase, trial: _Trial, amount: float) -> float | None:
    """Return the size at which a gain that grows with the square of the size would just show.

    A size that the logs cannot exclude does not show: the size that they suggest, `amount` times that of the trial,
    and beside it the error of such a value.
    """
    parameters, share = trial.parameters, trial.share
    enough = share * math.sqrt(SURELY_SHOWN_FACTOR * LEAST_GAIN / trial.strength)
    kind, finest = get_effect(parameters.id).kind, find_finest_size(case.tractor, parameters.id)
    error = compute_shared_error(case.residual_model, ModelTerm(parameters, trial.coordinates))
    chance = INTERVAL_SIGMAS * share / math.sqrt(trial.strength)
    suggested = abs(amount) * share + math.hypot(chance, error / parameters.typical[0])
    return convert_nonfinite_to_none(
        kind.compute_smallest_detectable(trial.coordinates, max(enough, suggested), parameters.typical[0], finest)
    )


def _find_middle_circle(residual_model: ResidualModel) -> tuple[float, float, float]:
    """Return a circle about the middle of the driving, with a quarter of its spread."""
    east = np.concatenate([segment.east for segment in residual_model.dataset.segments])
    north = np.concatenate([segment.north for segment in residual_model.dataset.segments])
    radius = 0.25 * float(max(np.ptp(east), np.ptp(north)))
    origin = residual_model.dataset.origin
    return float(np.median(east)) + origin[0], float(np.median(north)) + origin[1], radius


SettingsByEffect = Mapping[str, dict[str, float]]


def choose_next_drive(
    residual_model: ResidualModel,
    fit: EffectFit,
    tractor: Tractor,
    competitors: Mapping[str, SettingsByEffect],
    found_values: SettingsByEffect,
) -> NextDrive | None:
    """Return the shortest decisive drive for the first set of alternatives; the most telling one when none decides.

    `found_values` are the values of names, which the fit may lack.
    """
    for name, competitors_of_name in competitors.items():
        for competitor, values in competitors_of_name.items():
            other_settings = {
                effect_name: effect_values for effect_name, effect_values in fit.settings.items() if effect_name != name
            }
            competitor_settings = ({name: found_values[name], **fit.settings}, {**other_settings, competitor: values})
            scored_programmes = [
                (
                    programme,
                    compute_programme_separation(
                        residual_model, programme, tractor, competitor_settings, (name, competitor)
                    ),
                )
                for programme in DRIVE_PROGRAMMES
            ]
            decisive = [
                scored_programme for scored_programme in scored_programmes if scored_programme[1] > DECISIVE_LOSS
            ]
            programme, score = (
                min(decisive, key=lambda o: o[0].seconds) if decisive else max(scored_programmes, key=lambda o: o[1])
            )
            return NextDrive(
                programme.id, programme.description, programme.seconds, (name, competitor), score, score > DECISIVE_LOSS
            )
    return None


def compute_programme_separation(
    residual_model: ResidualModel,
    programme: DriveProgramme,
    tractor: Tractor,
    competitor_settings: tuple[SettingsByEffect, SettingsByEffect],
    names: tuple[str, str],
) -> float:
    """Return what separates two effects: the smaller of the two losses of explaining one's drive by the other."""
    heading, pace = find_usual_heading_and_speed(residual_model.dataset.segments)
    losses = []
    for true_settings, wrong_settings, name in (
        (competitor_settings[0], competitor_settings[1], names[1]),
        (competitor_settings[1], competitor_settings[0], names[0]),
    ):
        simulated = simulate_programme(residual_model.rig, programme, heading, pace, true_settings)
        trial = build_residual_model(
            simulated, replace(residual_model.rig, origin=(0.0, 0.0)), true_settings, residual_model.noise
        )
        trial = give_constant_channel_weights(residual_model, trial)
        losses.append(_compute_competitor_misfit(trial, tractor, wrong_settings, name))
    return min(losses)


def give_constant_channel_weights(residual_model: ResidualModel, trial: ResidualModel) -> ResidualModel:
    """Return the residual model of a simulated drive with the usual weights of the logs' wheel angles and speeds."""
    return replace(
        trial,
        wheel=_make_constant_channel_weights(residual_model.wheel, trial),
        speed=_make_constant_channel_weights(residual_model.speed, trial),
    )


def _make_constant_channel_weights(
    channels: tuple[ResidualChannel | None, ...], trial: ResidualModel
) -> tuple[ResidualChannel | None, ...]:
    """Return the weights of the logs' own channels, constant over the rows."""
    known_channels = [channel_sigma for channel_sigma in channels if channel_sigma is not None]
    if not known_channels:
        return tuple(None for _ in trial.dataset.segments)
    level = float(np.median(np.concatenate([channel_sigma.sigma for channel_sigma in known_channels])))
    rows = [np.full(segment.rows, level) for segment in trial.dataset.segments]
    return tuple(ResidualChannel(channel_sigma, known_channels[0].memory, channel_sigma) for channel_sigma in rows)


def _compute_competitor_misfit(
    trial: ResidualModel, tractor: Tractor, wrong_settings: SettingsByEffect, name: str
) -> float:
    """Return the loss of the other effect after refitting its value."""
    parameters: EffectParameters = build_parameters(tractor, name)
    other_settings = {k: v for k, v in wrong_settings.items() if k != name}
    residuals = trial.compute_residuals(other_settings)
    empty = EffectFit((), residuals, np.zeros((len(residuals), 0)))
    return (
        empty.loss
        - fit_candidate(
            trial.copy_with_fixed_effects(other_settings).compute_changes, empty, parameters, Projector(empty.jacobian)
        ).gain
    )
