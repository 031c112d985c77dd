"""Hints where an error has no name: what it depends on, and which instrument or block of the chain shows it.

A hint is no cause. Laws that explain a part come first, then what bends the path or changes the speed in proportion to
something, then with what the size of the error goes together: signs of errors cancel where a cause changes its
direction, so the squares of blocks of ten seconds are compared with what was driven in them, by ranks (one odd block is
one rank).

A tractor file has one acceleration. A tractor that gathers speed faster is metres ahead after a start, which no cause
of the path explains; at the measured speed nothing of it is left.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vehicle.identification.cause_selection.covariates import (
    CovariateScore,
    ErrorCovariate,
    list_covariates,
    score_covariates,
)
from vehicle.identification.diagnosis.results import EQUIVALENT, LIKELY, NAMED, Diagnosis, Hint
from vehicle.identification.faults.heading_kind import find_double_swing, find_heading_scale
from vehicle.identification.faults.turning_kind import measure_compass_share
from vehicle.identification.fit.open_loop import collect_run_settings
from vehicle.identification.fit.residual_fit import EffectFit
from vehicle.identification.laws.bases import RunClock, get_angle_deg
from vehicle.identification.laws.selection import FoundLaw
from vehicle.identification.laws.settle import LawSelection
from vehicle.identification.laws.words import KIND_WORDS
from vehicle.identification.logs.schema import Array, Log, Mask
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.identification.replay.instrument_timing import compute_timing, simulate_logged_speeds
from vehicle.identification.replay.rig import replay_segment
from vehicle.identification.replay.state_cache import FORWARD_COLUMN
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import (
    AT_CHANGES_SHARE,
    CHANCE_SIGMAS,
    CLUE_SIGMAS,
    CLUE_TIMES,
    HINT_MISFIT,
    LEAST_STRENGTH,
    MOST_OF_THIRD,
)
from vehicle.identification.verdict.held_out_case import DiagnosisCase
from vehicle.identification.verdict.wandering import HeadingWitness, describe_wander
from vehicle.model.discrepancy_model import TERMS_BY_NAME
from vehicle.model.effect_kinds import INTERVAL_SIGMAS, PER_SLOPE
from vehicle.model.effects import PATH, SPEED, get_effect

FEWEST_BLOCKS = 12  # chosen: ranks of fewer blocks show nothing
START_S = 3.0  # chosen: a drive line of any make has reached its speed after so long
MOVING_MPS = 0.15
AT_STARTS = "starts and stops"
STEADY_MPS2 = 0.1  # chosen: slower changes are drift of a controller
SETTLING_S = 2.0  # chosen: a drive line of any make has reached its speed so long after the simulated one
DRIFT_ACROSS = "cross_slope_drift"
_FAKED_BY_GYROSCOPE = frozenset({"heading_bias", "heading_delay", "heading_filter", "clock_offset_heading"})
LEAST_COMPASS_SHARE = 0.5  # between a drift (0) and a compass (1)
MOST_HINTS = 4  # chosen: a longer list is of no use to a reader
INSTRUMENT_WORDS = {
    "position": "the positions",
    "heading": "the headings",
    "steering": "the wheel angle",
    "speed": "the speed",
}
Quantity = Callable[[DriveSegment], Array]
"""What an error may go together with, per row (k,)."""


def add_hints(diagnosis: Diagnosis, law_selection: LawSelection, case: DiagnosisCase, clock: RunClock) -> Diagnosis:
    """Return a diagnosis with hints on an error that the names do not explain, without what headings contradict.

    Where positions alone wander, the first hint says so.
    """
    witness = HeadingWitness(case.residual_model, case.fit_without_terms, case.found_values)
    hints = (*diagnosis.hints, *list_hints(law_selection, case, clock, witness))
    if witness.wander_m is not None:
        hints = (describe_wander(witness.wander_m), *hints)
    missed = [one for one in list_covariates(case.residual_model) if one.description in diagnosis.depends_on]
    shown = [one for one in missed if witness.wander_m is None and not witness.contradicts(one)]
    if len(shown) == len(missed):
        return replace(diagnosis, hints=hints)
    words = {one.description for one in shown}
    is_named = diagnosis.named or any(one.status == EQUIVALENT for one in diagnosis.findings)
    block = diagnosis.guilty_block if is_named else next((one.block for one in shown), None)
    depends_on = tuple(clause for clause in diagnosis.depends_on if clause in words)
    return replace(diagnosis, depends_on=depends_on, guilty_block=block, hints=hints)


def hint_at_withdrawn(diagnosis: Diagnosis, names: Collection[str]) -> Diagnosis:
    """Return a diagnosis with hints on effects that were found and withdrawn again, unless their findings tell them.

    What an effect lowers in the runs that it is fitted to, and raises in others, depends on much the same.
    """
    untold = [one.id for one in diagnosis.findings if one.status not in (NAMED, LIKELY, EQUIVALENT)]
    effects = [get_effect(name) for name in untold if name in names]
    hints = tuple(
        Hint(
            effect.regressor,
            None,
            effect.block,
            f"The {effect.label} lowers the error where it is fitted and raises it in runs that had no part in that: "
            f"look for another cause that depends on {effect.regressor}.",
        )
        for effect in effects
    )
    return replace(diagnosis, hints=(*hints, *diagnosis.hints)[:MOST_HINTS])


def list_hints(
    law_selection: LawSelection, case: DiagnosisCase, clock: RunClock, witness: HeadingWitness
) -> tuple[Hint, ...]:
    """Return hints on an error that the names do not explain; several of one dependence count once.

    Without terms and covariates, an error barely above noise calls for none.
    """
    terms = case.extension.term_ids & frozenset(TERMS_BY_NAME)
    if not terms and not law_selection.selection.unnamed and case.remaining_misfit < HINT_MISFIT:
        return ()
    hints: list[Hint] = []
    for hint in _generate_hints(law_selection, case, clock, witness):
        if all(hint.words != other.words for other in hints):
            hints.append(hint)
    return tuple(hints[:MOST_HINTS])


@dataclass(frozen=True)
class WrongHeading:
    """A hint on an instrument that measures headings wrongly, and the effects that only stand in for that."""

    hint: Hint
    faked_ids: frozenset[str]


def find_wrong_heading(logs: Sequence[Log], found_values: Mapping[str, Mapping[str, float]]) -> WrongHeading | None:
    """Return what is wrong with the headings in a way that no effect describes: those of a compass or a gyroscope."""
    return _find_compass(logs, found_values) or _find_compass_of_two_swings(logs) or _find_gyroscope(logs)


def _find_compass(logs: Sequence[Log], found_values: Mapping[str, Mapping[str, float]]) -> WrongHeading | None:
    """Return a hint where what looks like a drift across a slope is in the headings, as of a compass near iron.

    A drift that follows the measured slope of the ground is one.
    """
    drift = found_values.get(DRIFT_ACROSS, {})
    if not drift or PER_SLOPE in drift:
        return None
    share, error = measure_compass_share(logs, drift["ratio"], drift["bearing_deg"])
    if share - INTERVAL_SIGMAS * error < LEAST_COMPASS_SHARE:
        return None
    wrong_deg = math.degrees(share * drift["ratio"])
    words = (
        f"The headings are wrong by up to {abs(wrong_deg):.1f} degrees, depending on the direction of travel, as of a "
        "compass near iron: they turn by as much more or less than the wheels turn the vehicle. Otherwise this looks "
        "like a drift across a slope."
    )
    return WrongHeading(Hint("the direction of travel", "heading", None, words), frozenset({DRIFT_ACROSS}))


def _find_compass_of_two_swings(logs: Sequence[Log]) -> WrongHeading | None:
    """Return a hint where headings leave the course to and fro twice per turn, as of a compass near unmagnetic iron."""
    swing = find_double_swing(logs)
    if swing is None:
        return None
    words = (
        f"The headings are wrong by up to {math.degrees(swing):.1f} degrees, depending on the direction of travel, as "
        "of a compass near iron: the error changes to and fro twice in each full turn. Calibrate the compass where it "
        "is mounted."
    )
    faked_ids = _FAKED_BY_GYROSCOPE | {DRIFT_ACROSS}
    return WrongHeading(Hint("the direction of travel", "heading", None, words), faked_ids)


def _find_gyroscope(logs: Sequence[Log]) -> WrongHeading | None:
    """Return a hint where headings turn by another amount than the path, as of a gyroscope whose scale is off."""
    scale = find_heading_scale(logs)
    if scale is None:
        return None
    words = (
        f"The headings turn by about {100.0 * abs(scale):.1f} % {'more' if scale > 0.0 else 'less'} than the path "
        "does, as of a gyroscope whose scale is off, so they are wrong after every turn."
    )
    return WrongHeading(Hint("turns of the heading", "heading", None, words), _FAKED_BY_GYROSCOPE)


def _generate_hints(
    law_selection: LawSelection, case: DiagnosisCase, clock: RunClock, witness: HeadingWitness
) -> Iterator[Hint]:
    selection = law_selection.selection
    settled = {(law.found.effect_id, law.found.kind) for law in law_selection.laws}
    best: dict[str, FoundLaw] = {}
    for found in sorted(law_selection.outcome.scores, key=lambda one: -one.score.gain):
        is_excluded = witness.wander_m is not None and found.score.target.moves_path
        if (found.effect_id, found.kind) not in settled and not is_excluded:
            best.setdefault(found.effect_id, found)
    for found in list(best.values())[:2] if not law_selection.laws else ():
        yield _describe_law(found)
    for covariate in selection.unnamed[:2]:
        if not witness.contradicts(covariate):
            yield _describe_covariate(covariate)
    by_words = {covariate.description: covariate for covariate in list_covariates(case.residual_model)}
    for term in (TERMS_BY_NAME[name] for name in TERMS_BY_NAME if name in case.extension.term_ids):
        clause = f"{term.effect} that depends on {term.regressor}"
        if clause not in by_words or not witness.contradicts(by_words[clause]):
            yield Hint(term.regressor, None, PATH, f"The error looks like {clause}.")
    if not selection.unnamed:
        strongest = find_strongest_covariate(selection.residual_model, case.fit_without_terms)
        if strongest is not None and not witness.contradicts(strongest):
            yield _describe_covariate(strongest)
    yield from (_describe_clue(clue) for clue in find_clues(selection.residual_model, case.fit_without_terms, clock))


def _describe_law(found: FoundLaw) -> Hint:
    effect = get_effect(found.effect_id)
    depends_on = KIND_WORDS[found.kind]
    words = f"A part of the error would go if the {effect.label} changed with {depends_on}."
    return Hint(depends_on, None, effect.block, words)


def _describe_covariate(covariate: ErrorCovariate) -> Hint:
    words = f"The error looks like {covariate.description}."
    return Hint(covariate.regressor, None, covariate.block, words)


def _describe_clue(clue: Clue) -> Hint:
    high, low = _WHERE_WORDS[clue.depends_on]
    more, less = (high, low) if clue.times > 1.0 else (low, high)
    times = max(clue.times, 1.0 / clue.times)
    words = (
        f"Errors of {INSTRUMENT_WORDS[clue.instrument]} are {times:.1f} times as large {more} as {less}: look for what "
        "differs there."
    )
    return Hint(clue.depends_on, clue.instrument, None, words)


# --- clues: what the size of the error goes together with ------------------------------------------------------------


@dataclass(frozen=True)
class Clue:
    """With what the error of an instrument goes together: words, instrument, strength in standard deviations, and how
    many times as large it is in the third of the drive with most of that as in the third with least."""

    depends_on: str
    instrument: str
    sigmas: float
    times: float


def _measure_start(segment: DriveSegment) -> Array:
    """Return 1 in rows within a few seconds of standing still, else 0."""
    standing = np.abs(segment.speed) < MOVING_MPS
    times = segment.time[standing]
    if len(times) == 0:
        return np.zeros(segment.rows)
    place = np.searchsorted(times, segment.time)
    before = np.abs(segment.time - times[np.maximum(place - 1, 0)])
    after = np.abs(segment.time - times[np.minimum(place, len(times) - 1)])
    return np.asarray((np.minimum(before, after) < START_S).astype(np.float64))


def _measure_acceleration(segment: DriveSegment) -> Array:
    return np.abs(np.gradient(segment.speed, segment.time))


def _measure_steering_rate(segment: DriveSegment) -> Array:
    return np.abs(np.gradient(get_angle_deg(segment), segment.time))


# Where a quantity of list_quantities is large, and where it is small.
_WHERE_WORDS = {
    "speed": ("at high speed", "at low speed"),
    "the size of the wheel angle": ("in tight bends", "near straight ahead"),
    "the side": ("in bends to the right", "in bends to the left"),
    "the rate of steering": ("while the wheels are steered fast", "while their angle is held"),
    AT_STARTS: ("near starts and stops", "away from starts and stops"),
    "changes of speed": ("while the speed changes", "at a steady speed"),
    "the implement": ("with the implement working", "with the implement lifted"),
    "driving in reverse": ("in reverse", "forwards"),
    "time since the start": ("late in the runs", "early in the runs"),
    "the place, east to west": ("in the east", "in the west"),
    "the place, north to south": ("in the north", "in the south"),
    "the direction of travel": ("on the way north", "on the way south"),
    "the time of day": ("late in the day", "early in the day"),
}


def list_quantities(clock: RunClock) -> dict[str, Quantity]:
    """Return what errors may go together with, per row (k,)."""
    quantities: dict[str, Quantity] = {
        "speed": lambda s: s.speed_in_gear,
        "the size of the wheel angle": lambda s: np.abs(get_angle_deg(s)),
        "the side": lambda s: np.sign(np.round(get_angle_deg(s))),
        "the rate of steering": _measure_steering_rate,
        AT_STARTS: _measure_start,
        "changes of speed": _measure_acceleration,
        "the implement": lambda s: s.working,
        "driving in reverse": lambda s: np.full(s.rows, float(s.gear < 0.0)),
        "time since the start": lambda s: s.start_s + s.time,
        "the place, east to west": lambda s: s.east,
        "the place, north to south": lambda s: s.north,
        "the direction of travel": lambda s: s.gear * np.sin(s.heading),
    }
    if clock.has_order:
        quantities["the time of day"] = clock.compute_time
    return quantities


def find_clues(residual_model: ResidualModel, fit: EffectFit, clock: RunClock) -> list[Clue]:
    """Return the clues beyond chance that change an error much, the strongest first, one per instrument at most."""
    rows = residual_model.dataset.rows
    blocks = residual_model.residual_blocks[3 * rows : 4 * rows]
    count = len(residual_model.block_runs)
    if count < FEWEST_BLOCKS:
        return []
    sizes = np.maximum(np.bincount(blocks, minlength=count), 1)
    quantities = {
        name: np.bincount(
            blocks, np.concatenate([measure(segment) for segment in residual_model.dataset.segments]), count
        )
        / sizes
        for name, measure in list_quantities(clock).items()
    }
    has_heading = any(segment.heading_measured for segment in residual_model.dataset.segments)
    clues = (
        _choose_clue(instrument, np.bincount(blocks, squares, count) / sizes, quantities)
        for instrument, squares in _split_squares(residual_model, fit).items()
        if instrument != "heading" or has_heading
    )
    return sorted((clue for clue in clues if clue is not None), key=lambda clue: -clue.sigmas)


def _choose_clue(instrument: str, energy: Array, quantities: Mapping[str, Array]) -> Clue | None:
    """Return what the squared errors of an instrument (b,) most clearly go together with, of quantities (b,) by name.

    None where that makes them little larger. The error of any speed sensor is a share of its speed, which says nothing.
    """
    ranked = [
        Clue(name, instrument, _compute_rank_sigmas(values, energy), _compare_thirds(values, energy))
        for name, values in quantities.items()
        if np.ptp(values) > 0.0 and np.ptp(energy) > 0.0
    ]
    telling = [
        clue
        for clue in ranked
        if clue.sigmas > CLUE_SIGMAS
        and max(clue.times, 1.0 / clue.times) >= CLUE_TIMES
        and (clue.instrument, clue.depends_on) != ("speed", "speed")
    ]
    return max(telling, key=lambda clue: clue.sigmas, default=None)


def _compare_thirds(values: Array, energy: Array) -> float:
    """Return how many times as large errors are in the third of blocks (b,) with the largest values as in that with the
    smallest, from their squares `energy` (b,).

    Of values that many blocks share, such as those of a gear, all blocks above the middle count against all others.
    """
    low, high = (np.quantile(values, share) for share in (1.0 / 3.0, 2.0 / 3.0))
    is_low, is_high = values <= low, values >= high
    if low == high or np.mean(is_low) > MOST_OF_THIRD or np.mean(is_high) > MOST_OF_THIRD:
        is_high = values > 0.5 * (values.min() + values.max())
        is_low = ~is_high
    if not (is_low.any() and is_high.any()):
        return 1.0
    means = [math.sqrt(float(energy[rows].mean())) for rows in (is_low, is_high)]
    least = 1e-3 * math.sqrt(float(energy.mean()))
    return max(means[1], least) / max(means[0], least)


def _split_squares(residual_model: ResidualModel, fit: EffectFit) -> dict[str, Array]:
    """Return squared residuals per row (rows,) by instrument; those of missing columns are 0."""
    rows, squares = residual_model.dataset.rows, fit.residuals**2
    path = squares[: 3 * rows].reshape(-1, 3)
    return {
        "position": path[:, 0] + path[:, 1],
        "heading": path[:, 2],
        "steering": squares[3 * rows : 4 * rows],
        "speed": squares[4 * rows :],
    }


def _compute_rank_sigmas(values: Array, energy: Array) -> float:
    """Return how many standard deviations the rank correlation of two columns (b,) is from none."""
    from scipy.stats import rankdata

    share = float(np.corrcoef(rankdata(values), rankdata(energy))[0, 1])
    return math.atanh(min(abs(share), 0.999)) * math.sqrt(len(values) - 3)


def find_strongest_covariate(residual_model: ResidualModel, fit: EffectFit) -> ErrorCovariate | None:
    """Return the covariate that explains most beyond chance, if any does; several amounts are granted more chance."""

    def compute_net_gain(score: CovariateScore) -> float:
        return score.gain - score.freedoms - CHANCE_SIGMAS * math.sqrt(2.0 * score.freedoms)

    best = max(score_covariates(residual_model, fit), key=compute_net_gain, default=None)
    return best.covariate if best is not None and compute_net_gain(best) > LEAST_STRENGTH else None


# --- starts and stops that differ from those of the tractor file -----------------------------------------------------


def describe_speed_changes(case: DiagnosisCase) -> Hint | None:
    """Return a hint where the speed differs from the simulated one nearly only while it changes.

    None elsewhere, and where a log lacks measured or commanded speeds.
    """
    at_changes, total, lead = 0.0, 0.0, 0.0
    for segment in case.residual_model.dataset.segments:
        if segment.target is None or not segment.speed_measured:
            return None
        simulated = _simulate_speed(case, segment)
        rate, squares = np.gradient(simulated, segment.time), (segment.speed - simulated) ** 2
        changing = find_speed_changes(segment.time, rate)
        at_changes, total = at_changes + float(squares[changing].sum()), total + float(squares.sum())
        lead += float((segment.speed - simulated) @ rate)
    if total == 0.0 or at_changes < AT_CHANGES_SHARE * total:
        return None
    words = (
        f"At {AT_STARTS} the speed changes {'faster' if lead > 0.0 else 'more slowly'} than the tractor file says; "
        "between them it follows the commands."
    )
    return Hint(AT_STARTS, None, SPEED, words)


def _simulate_speed(case: DiagnosisCase, segment: DriveSegment) -> Array:
    """Return the speed (k, m/s) that the commands give with everything that was found."""
    settings = {**case.tolerated, **collect_run_settings(case.extension.terms, segment.run)}
    states = replay_segment(case.residual_model.rig, segment, settings, from_sensor=True, from_speed=False)
    return simulate_logged_speeds(segment, states[:, FORWARD_COLUMN], compute_timing(settings))


def find_speed_changes(time: Array, rate: Array) -> Mask:
    """Return the rows (k,) during changes of a speed with this rate (k, m/s2), and shortly before and after."""
    changes = time[np.abs(rate) > STEADY_MPS2]
    if not len(changes):
        return np.zeros(len(time), dtype=np.bool_)
    after = np.searchsorted(changes, time)
    nearest = np.minimum(
        np.abs(time - changes[np.maximum(after - 1, 0)]), np.abs(time - changes[np.minimum(after, len(changes) - 1)])
    )
    return np.asarray(nearest <= SETTLING_S)
