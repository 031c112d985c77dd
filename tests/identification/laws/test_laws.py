"""Laws of parameters: recovered where they act, not told where values are constant."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.identification.analytic_drives import course_of
from tests.identification.log_tables import table
from tests.identification.residual_models import build_commanded_model, build_programme_model, eg105
from vehicle.identification.fit.effect_parameters import build_parameters
from vehicle.identification.fit.residual_fit import EffectFit, make_empty_fit, refine_fit
from vehicle.identification.laws import settle
from vehicle.identification.laws.bases import (
    BY_ANGLE,
    BY_IMPLEMENT,
    BY_SIDE,
    BY_SPEED,
    LawBasis,
    RunClock,
    build_group_basis,
    build_run_clock,
    get_angle_deg,
    list_bases,
)
from vehicle.identification.laws.columns import GAIN, OFFSET, SIDE_SLIP, LawColumns, list_targets
from vehicle.identification.laws.scores import LawScorer
from vehicle.identification.laws.selection import (
    UNDERSTEER,
    _is_bent_at_work,
    compute_law_range,
    is_gain_by_speed,
)
from vehicle.identification.laws.settle import (
    ActingLaw,
    LawResidualModel,
    add_law,
    is_contradicted_by_headings,
    is_shadow_of_covariates,
    measure_heading_share,
    settle_laws,
)
from vehicle.identification.laws.sides import LEFT, RIGHT, _measure_worth, find_only_side, find_sides
from vehicle.identification.logs.reader import build_log
from vehicle.identification.replay.drive_programmes import build_command_segment
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.model.effects import get_effect
from vehicle.records import GRAVITY_MPS2

PER_MPS = 0.05


@pytest.fixture(scope="module")
def plain() -> ResidualModel:
    """A tractor as its file says, on circles at several angles."""
    return build_programme_model("circles", {})


def get_basis(residual_model: ResidualModel, kind: str) -> LawBasis:
    runs = len(residual_model.dataset.names)
    clock = RunClock(np.zeros(runs), 0.0, has_order=False)
    return next(basis for basis in list_bases(residual_model.dataset, clock) if basis.kind == kind)


def test_columns_of_a_law_are_what_the_law_does_to_the_residuals(plain: ResidualModel) -> None:
    fit = make_empty_fit(plain)
    columns, basis = LawColumns(plain, fit), get_basis(plain, BY_ANGLE)
    target = next(one for one in list_targets(plain, fit) if one.effect_id == GAIN)
    units = columns.compute_unit_increments(target)
    law = ActingLaw(GAIN, basis, np.zeros(1), np.array([1e-4]), units)
    change = add_law(plain, law).compute_residuals({}) - plain.compute_residuals({})
    expected = 1e-4 * columns.compute_columns(target, basis)[:, 0]
    assert np.abs(change).max() > 0.01
    assert change == pytest.approx(expected, abs=0.02 * np.abs(change).max())


def test_an_offset_may_grow_with_the_speed_and_a_gain_by_side_is_an_asymmetry(plain: ResidualModel) -> None:
    targets = {one.effect_id: one for one in list_targets(plain, make_empty_fit(plain))}
    assert targets[OFFSET].allows(BY_SPEED) and not targets[OFFSET].allows(BY_IMPLEMENT)
    assert not targets[GAIN].allows(BY_SIDE)


def test_headings_tell_whether_a_law_turns_the_tractor_or_moves_its_positions_alone(plain: ResidualModel) -> None:
    columns, basis = LawColumns(plain, make_empty_fit(plain)), get_basis(plain, BY_ANGLE)
    gain = next(one for one in list_targets(plain, columns.fit) if one.effect_id == GAIN)
    law = ActingLaw(GAIN, basis, np.zeros(1), np.array([0.01]), columns.compute_unit_increments(gain))
    changing = add_law(plain, law)
    moves = zip(plain.simulate_increments({}), changing.simulate_increments({}), strict=True)
    turns = [np.cumsum([0.0, *(after.turned - before.turned)]) for before, after in moves]

    def show(share: float, is_measured: bool = True) -> LawResidualModel:
        segments = [
            replace(segment, heading=segment.heading + share * turn, heading_measured=is_measured)
            for segment, turn in zip(plain.dataset.segments, turns, strict=True)
        ]
        return replace(changing, dataset=replace(plain.dataset, segments=segments))

    for share in (0.0, 0.3, 1.0):
        assert measure_heading_share(show(share), {})[0] == pytest.approx(share, abs=0.05)
        assert is_contradicted_by_headings(show(share), {}) == (share < 0.5)
    assert not is_contradicted_by_headings(show(0.0, is_measured=False), {})


def replace_settings(fit: EffectFit, settings: dict[str, dict[str, float]]) -> EffectFit:
    """A fit with these effects, each at its value."""
    parts = []
    for name, values in settings.items():
        parameters = build_parameters(eg105(), name)
        kind, params = get_effect(name).kind, get_effect(name).params
        parts.append((parameters, kind.compute_coordinates(params, values)[0]))
    return replace(fit, parts=tuple(parts))


def test_tyres_near_their_limit_show_nothing_of_a_law() -> None:
    """Three times as fast a circle needs nine times the grip: with a limit in between, only the slow one counts."""
    model = build_programme_model("two-speeds", {})
    fit = make_empty_fit(model)
    target = next(one for one in list_targets(model, fit) if one.effect_id == GAIN)
    (free,) = LawColumns(model, fit).compute_unit_increments(target)
    assert (np.abs(free.turned[5:]) > 0.0).all()
    (move,) = model.simulate_increments({})
    lateral = np.abs(move.turned * move.ahead) / np.diff(model.dataset.segments[0].time) ** 2 / GRAVITY_MPS2
    limit = {SIDE_SLIP: {"limit_g": 3.0 * float(np.median(lateral[50:150]))}}
    (kept,) = LawColumns(model, replace_settings(fit, limit)).compute_unit_increments(target)
    assert (np.abs(kept.turned[50:150]) > 0.0).all() and not kept.turned[-100:].any()


def test_amount_of_a_law_is_recovered() -> None:
    """Logs that bend less with the speed than the model: the step of the score is the law with its sign turned."""
    plain = build_programme_model("two-speeds", {})
    fit = make_empty_fit(plain)
    columns, basis = LawColumns(plain, fit), get_basis(plain, BY_SPEED)
    target = next(one for one in list_targets(plain, fit) if one.effect_id == GAIN)
    units = columns.compute_unit_increments(target)
    model = add_law(plain, ActingLaw(GAIN, basis, np.zeros(1), np.array([PER_MPS]), units))
    wrong = make_empty_fit(model)
    again = LawColumns(model, wrong)
    scorer = LawScorer(
        model,
        wrong,
        target,
        again.compute_columns(target, again.constant),
        [again.compute_columns(target, basis)],
    )
    score = scorer.score_law(0, basis)
    assert score.amounts[0] == pytest.approx(-PER_MPS, rel=0.1)
    assert score.gain > 25.0


@pytest.mark.parametrize(("programme", "is_alike"), [("two-speeds", True), ("shuffled-bends", False)])
def test_understeer_is_a_gain_by_speed_where_logs_hold_two_speeds(programme: str, is_alike: bool) -> None:
    """A square of the speed is a line through two speeds, and none through many."""
    values = {"deg_per_mps2": 2.0}
    model = build_programme_model(programme, {UNDERSTEER: values})
    residuals, clock = model.compute_residuals({UNDERSTEER: values}), RunClock(np.zeros(1), 0.0, has_order=False)
    part = (build_parameters(eg105(), UNDERSTEER), np.array([2.0]))
    fit = refine_fit(model, EffectFit((part,), residuals, np.zeros((len(residuals), 0))))
    assert is_gain_by_speed(model, fit, clock) == is_alike
    assert not is_gain_by_speed(model, make_empty_fit(model), clock)


def test_angles_beyond_the_widest_are_held(plain: ResidualModel) -> None:
    segment = plain.dataset.segments[0]
    wide = replace(segment, wheel=np.full(segment.rows, np.radians(33.0)))
    assert np.all(get_basis(plain, BY_ANGLE).compute_rows(wide) == 27.0)
    assert get_angle_deg(wide)[0] == pytest.approx(33.0)


def test_groups_of_runs_are_columns_of_ones(plain: ResidualModel) -> None:
    segment = replace(plain.dataset.segments[0], run=1)
    assert np.all(build_group_basis([0, 1], 2).compute_rows(segment) == 1.0)
    assert np.all(build_group_basis([1, 0], 2).compute_rows(segment) == 0.0)


def test_wheels_are_to_move_to_the_side_of_the_command(plain: ResidualModel) -> None:
    segment = plain.dataset.segments[0]
    wheel, command = np.zeros(segment.rows), np.zeros(segment.rows)
    command[5:20], command[40:60] = np.radians(2.0), np.radians(-2.0)
    sides = find_sides(replace(segment, wheel=wheel, command=command))
    assert sides[0] == 0.0
    assert np.all(sides[5:40] == 1.0)
    assert np.all(sides[40:] == -1.0)


def test_runs_that_begin_at_the_same_time_have_no_day() -> None:
    logs = [build_log(table(), f"run {number}") for number in range(4)]
    assert not build_run_clock(logs, range(4)).has_order


def test_runs_one_after_another_have_a_day() -> None:
    logs = [build_log(table().assign(time_s=table().time_s + 500.0 * n), f"run {n}") for n in range(4)]
    clock = build_run_clock(logs, range(4))
    assert clock.has_order
    assert clock.starts_s.tolist() == [0.0, 500.0, 1000.0, 1500.0]


@pytest.mark.parametrize(
    ("angles", "side"),
    [((20.0, 10.0), RIGHT), ((-8.0, -15.0), LEFT), ((20.0, -10.0), None), ((20.0, -1.0), RIGHT), ((20.0, -2.5), None)],
)
def test_bends_to_one_side_are_known_despite_small_corrections(angles: tuple[float, ...], side: int | None) -> None:
    """An angle of an eighth has a sixty-fourth of the information, one of a twentieth a four hundredth."""
    drive = build_command_segment(0, 0.0, tuple((20.0, angle, 1.0, 0.0) for angle in angles), 1.4)
    assert find_only_side(course_of(drive)) == side


def test_a_value_for_each_side_is_worth_what_it_removes_in_the_other_runs() -> None:
    """The wheels move at 6 deg/s to both sides: that removes all of the error, twice the file's rate none."""
    model = build_commanded_model("steps", {"steering_rate": {"rate_deg_per_s": 6.0}})
    values = np.array([6.0, 32.0])
    slow, fast = (np.tile(losses, (2, 2, 1)).T for losses in ([0.0, 1.0], [1.0, 0.0]))
    runs = len(model.dataset.names)
    slow, fast = (np.repeat(losses[:, :, :1], runs + 1, axis=2) for losses in (slow, fast))
    assert _measure_worth(model, {}, "steering_rate", values, slow) > 95.0
    assert _measure_worth(model, {}, "steering_rate", values, fast) < 1.0


@pytest.mark.parametrize(
    ("low", "high", "is_shadow", "is_told"),
    [
        (0.9, 1.1, False, True),
        (0.9, 1.1, True, False),
        (1.0, 1.0, False, False),  # all that was left of a law in a furrow
        (-0.02, 1.0, False, False),  # runs whose wheel angles are noise
    ],
)
def test_a_law_is_told_where_something_possible_is_left_of_it(
    low: float, high: float, is_shadow: bool, is_told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = SimpleNamespace(moves_path=True, finest=0.02)
    score: Any = SimpleNamespace(target=target, gain=900.0)
    found = SimpleNamespace(effect_id=GAIN, kind=BY_SPEED, score=score)
    outcome = SimpleNamespace(laws=(found,), base_fit=SimpleNamespace(parts=(), settings={}))
    fit = SimpleNamespace(loss=100.0, settings={})
    selection: Any = SimpleNamespace(fit=fit, effect_ids=frozenset())
    settled = SimpleNamespace(fit=fit, residual_model=None)
    law = SimpleNamespace(low=low, high=high)
    monkeypatch.setattr(settle, "find_laws", lambda *_: outcome)
    monkeypatch.setattr(settle, "_is_own_effect", lambda *_: False)
    monkeypatch.setattr(settle, "_fit_with_law", lambda *_: settled)
    monkeypatch.setattr(settle, "drop_superfluous", lambda one: one)
    monkeypatch.setattr(settle, "_refine_law", lambda *_: (settled, score))
    monkeypatch.setattr(settle, "is_shadow_of_covariates", lambda _: is_shadow)
    monkeypatch.setattr(settle, "_read_law", lambda *_: law)
    nothing: Any = None
    told = settle_laws(selection, nothing, eg105())
    assert told.laws == ((law,) if is_told else ())
    assert told.selection is (settled if is_told else selection)


@pytest.mark.parametrize(("outer_share", "low", "high"), [(0.05, 0.0, 0.0), (0.0, -0.4, 0.0)])
def test_a_small_circle_is_no_range_and_a_short_work_is(outer_share: float, low: float, high: float) -> None:
    """One row in a hundred differs: a chance circle of the field, or the few rows in which an implement works."""
    values = np.where(np.arange(100) == 7, -0.4, 0.0)
    assert compute_law_range(values, np.ones(100), outer_share) == pytest.approx((low, high), abs=1e-12)


@pytest.mark.parametrize(("returned", "by_covariates", "is_shadow"), [(300.0, 100.0, False), (150.0, 100.0, True)])
def test_a_law_explains_twice_what_covariates_do_beside_it(
    plain: ResidualModel, returned: float, by_covariates: float, is_shadow: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    basis = get_basis(plain, BY_ANGLE)
    model = add_law(plain, ActingLaw(GAIN, basis, np.zeros(1), np.array([PER_MPS]), ()))
    selection: Any = SimpleNamespace(
        residual_model=model, fit=SimpleNamespace(loss=1000.0, parts=()), unnamed=("time",)
    )
    losses = {PER_MPS: 1000.0, 0.0: 1000.0 + returned}
    monkeypatch.setattr(
        settle, "refit_with_new_weights", lambda one, *_: SimpleNamespace(loss=losses[float(one.law.amounts[0])])
    )
    monkeypatch.setattr(settle, "compute_unnamed_gain", lambda _: by_covariates)
    assert is_shadow_of_covariates(selection) is is_shadow
    selection.unnamed = ()
    assert not is_shadow_of_covariates(selection)


def test_an_implement_shows_its_gain_by_bends_like_those_without_it(plain: ResidualModel) -> None:
    """At work in every other second, never, and only where the wheels are nearly straight."""
    angles = [np.abs(get_angle_deg(one)) for one in plain.dataset.segments]
    largest = max(angle.max() for angle in angles)
    every_other = [(np.floor(one.time) % 2.0) for one in plain.dataset.segments]
    gentle = [(angle < largest / 6.0).astype(float) for angle in angles]
    works = (every_other, [np.zeros(len(angle)) for angle in angles], gentle)
    assert [_is_bent_at_work(put_to_work(plain, work)) for work in works] == [True, False, False]


def put_to_work(model: ResidualModel, work: Sequence[Any]) -> ResidualModel:
    segments = tuple(replace(one, working=row) for one, row in zip(model.dataset.segments, work, strict=True))
    return replace(model, dataset=replace(model.dataset, segments=segments))
