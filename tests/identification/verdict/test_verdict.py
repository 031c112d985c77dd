"""The words of an answer, notes beside it, demonstrations and progress."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.identification.residual_models import build_programme_model, eg105, get_parameters
from vehicle.identification.fit.residual_fit import EffectFit
from vehicle.identification.thresholds import DECISIVE_LOSS, SAME_ERROR_FACTOR
from vehicle.identification.verdict.findings import choose_next_drive, compute_programme_separation
from vehicle.identification.verdict.hints import hint_at_withdrawn

from vehicle.identification.diagnosis.demo_logs import DEMO_PLACE, build_programme, draw_hidden_effect
from vehicle.identification.diagnosis.diagnose import (
    _choose_discrepancy_model,
    _find_named_cause_block,
    _list_covariates,
    _ProgressCounter,
)
from vehicle.identification.diagnosis.log_notes import _describe_file_corrections, _describe_logs
from vehicle.identification.diagnosis.results import (
    EQUIVALENT,
    LIKELY,
    NAMED,
    NOT_VISIBLE,
    Diagnosis,
    Finding,
    Hint,
    convert_nonfinite_to_none,
    join_clauses,
)
from vehicle.identification.replay.drive_programmes import DRIVE_PROGRAMMES
from vehicle.model.effects import CATALOGUE, EFFECTS_BY_ID, PATH, SPEED, check_effect, get_neutral_values
from vehicle.model.tractor import DiscrepancyModel, EffectSetting

REST = DiscrepancyModel(amounts={"push_to_east": 0.01}, speed_mps=(0.5, 2.0), angle_deg=(-10.0, 10.0))


def told(name: str, status: str, words: str = "Words.") -> Finding:
    return Finding(name, status, None, None, None, None, None, "", EFFECTS_BY_ID[name].block, words)


def answer(*findings: Finding, **more: Any) -> Diagnosis:
    values: dict[str, Any] = {
        "names": ("a",), "rows_used": 1, "rows_gated": 0, "minutes": 1.0, "ground": "soil", "before": {}, "after": {},
        "noise_floor": {}, "guilty_block": None, "block_error": {}, "findings": findings,
        "named": tuple(one.id for one in findings if one.status == NAMED), "unexplained_share": 0.0, "depends_on": (),
        "next_drive": None, "tractor": eg105(), "calibration": {}, "curve": None,
    }  # fmt: skip
    return Diagnosis(**(values | more))


def test_the_headline_says_the_most_that_is_known() -> None:
    named, one, other = (
        told("wheel_slip", NAMED, "It slips."),
        told("steering_offset", EQUIVALENT, "This."),
        told("implement_side_draft", EQUIVALENT, "That."),
    )
    assert answer(named, one, depends_on=("speed",)).headline == "It slips."
    assert answer(one, other).headline == "Several causes fit these logs equally well: This. Or: That."
    assert answer(depends_on=("a", "b", "c")).headline.endswith("the simulation misses a; b; and c.")
    assert answer(unexplained_share=0.4).headline.endswith("depends on none of the quantities examined.")
    hint = Hint("speed", "heading", None, "Errors of the headings go together with speed.")
    assert answer(unexplained_share=0.4, hints=(hint,)).headline.endswith(f"explains these logs. {hint.words}")
    assert answer(calibration={"wheel_slip": {"ratio": 0.1}}).headline.startswith("No cause found")
    assert answer(notes=("The tractor file already has x; ...",)).headline.startswith("Nothing found beyond")
    assert answer().headline.startswith("Nothing found: ")


def test_what_helps_some_runs_and_harms_others_hints_at_what_it_depends_on() -> None:
    """An effect whose finding tells it needs no hint, nor does one that was never found."""
    one, other = told("understeer", NOT_VISIBLE, ""), told("wheel_slip", LIKELY, "It may slip.")
    found = hint_at_withdrawn(answer(one, other), {"understeer", "wheel_slip"})
    assert [hint.depends_on for hint in found.hints] == ["lateral acceleration"]
    assert hint_at_withdrawn(answer(one, other), set()).hints == ()


def test_clauses_and_numbers() -> None:
    assert [join_clauses(parts) for parts in ([], ["a"], ["a", "b"], ["a", "b", "c"])] == [
        "",
        "a",
        "a and b",
        "a; b; and c",
    ]
    assert (
        convert_nonfinite_to_none(1.5) == 1.5
        and convert_nonfinite_to_none(float("inf")) is None
        and convert_nonfinite_to_none(float("nan")) is None
    )


def test_the_guilty_block_is_that_of_the_name_the_set_or_the_dependence() -> None:
    set_of = [told("wheel_slip", EQUIVALENT), told("steering_offset", NOT_VISIBLE)]
    selection: Any = SimpleNamespace(unnamed=(SimpleNamespace(block="x"),))
    assert _find_named_cause_block(["steering_offset"], set_of, selection) == PATH
    assert _find_named_cause_block([], set_of, selection) == SPEED and _find_named_cause_block([], [], selection) == "x"
    assert _find_named_cause_block([], [], SimpleNamespace(unnamed=())) is None
    assert _find_named_cause_block([], [], None) is None  # nothing is left that a block could be guilty of


def test_what_is_left_depends_on_unnamed_terms_or_on_the_rest_that_lowers_it() -> None:
    extension: Any = SimpleNamespace(
        term_ids=frozenset({"wheel_slip", "grip_by_speed", "grip_to_east", "grip_to_north"})
    )
    plain: Any = SimpleNamespace(unnamed=())
    words = ("a change of grip that depends on speed", "a change of grip that depends on the direction of travel")
    assert sorted(_list_covariates(plain, extension)) == sorted(words)
    assert _list_covariates(SimpleNamespace(unnamed=(SimpleNamespace(description="x"),)), extension) == ("x",)
    assert _list_covariates(plain, SimpleNamespace(term_ids=frozenset({"wheel_slip"}))) == ()


def test_a_rest_of_the_file_stays_unless_the_logs_speak_against_it() -> None:
    plain, mine = eg105(), eg105().model_copy(update={"discrepancy_model": REST})
    after = np.array([10.0])
    assert _choose_discrepancy_model(mine, plain, after * (SAME_ERROR_FACTOR - 0.01), after).discrepancy_model is REST
    assert _choose_discrepancy_model(mine, plain, after * (SAME_ERROR_FACTOR + 0.01), after).discrepancy_model is None
    newer = plain.model_copy(update={"discrepancy_model": REST.model_copy(update={"on": False})})
    assert (
        _choose_discrepancy_model(mine, newer, after, after) is newer
        and _choose_discrepancy_model(plain, plain, after, after) is plain
    )


def test_progress_never_runs_past_its_estimate() -> None:
    seen: list[tuple[int, int]] = []
    count = _ProgressCounter(lambda done, total: seen.append((done, total)))
    for _ in range(150):
        count.count_step()
    count.report_completion()
    assert all(done + 20 <= total for done, total in seen[:-1]) and seen[0] == (1, 100) and seen[-1] == (170, 170)
    _ProgressCounter(None).count_step()


def test_notes_of_logs_say_what_was_missing() -> None:
    residual_model = build_programme_model("there-and-back", {})
    assert _describe_logs([], residual_model) == ()
    bare = tuple(replace(one, wheel=None, target=None) for one in residual_model.dataset.segments)
    lines = _describe_logs([], replace(residual_model, dataset=replace(residual_model.dataset, segments=bare)))
    assert [line.split(" was")[0] for line in lines] == ["No wheel angle", "No commanded speed"]


def test_notes_of_a_file_say_what_became_of_its_effects_and_its_rest() -> None:
    slip = EffectSetting(value={"ratio": 0.1})
    known = {"steering_offset": EffectSetting(value={"angle_deg": 1.0}), "wheel_slip": slip}
    mine = eg105().model_copy(update={"effects": known, "discrepancy_model": REST})
    kept = answer(tractor=eg105().model_copy(update={"effects": {"wheel_slip": slip}, "discrepancy_model": REST}))
    one, two = _describe_file_corrections(mine, kept)
    assert "already has steering_offset, wheel_slip;" in one and one.endswith(
        "show wheel_slip; the value of the file was kept."
    )
    assert two == "The tractor file has a discrepancy model: kept, as these logs do not contradict it."
    assert _describe_file_corrections(mine, answer())[1].endswith("dropped, as these logs contradict it.")
    newer = answer(tractor=eg105().model_copy(update={"discrepancy_model": REST.model_copy(update={"on": False})}))
    assert _describe_file_corrections(mine, newer)[1].endswith("replaced.")
    assert _describe_file_corrections(eg105(), answer()) == ()


@given(st.integers(0, 10**6), st.sampled_from([None, *EFFECTS_BY_ID]))
def test_a_demonstration_hides_what_a_tractor_can_have(seed: int, name: str | None) -> None:
    hidden = draw_hidden_effect(seed, eg105(), name)
    assert hidden == draw_hidden_effect(seed, eg105(), name) and (name is None or hidden.id == name)
    check_effect(hidden.id, hidden.values)
    assert hidden.values != get_neutral_values(hidden.id, eg105().steering) and hidden.description.endswith(".")


def test_the_programme_of_a_demonstration_is_about_nine_minutes() -> None:
    seconds = [sum(piece[0] for piece in pieces) for _, _, pieces in build_programme()]
    assert sum(seconds) == pytest.approx(540.0, abs=60.0) and len({name for name, _, _ in build_programme()}) == 11
    assert DEMO_PLACE[2] > 0.0


def test_lifting_the_implement_tells_an_offset_from_a_draft() -> None:
    """An offset turns the tractor always, a draft while the implement works: drives without both tell nothing."""
    truth = {"steering_offset": {"angle_deg": 2.0}}
    competitor = {"implement_side_draft": {"curvature_per_m": 0.01}}
    residual_model = build_programme_model("there-and-back", truth)
    fit = EffectFit(((get_parameters("steering_offset"), np.array([2.0])),), residual_model.compute_residuals(truth),
              np.zeros((5 * residual_model.dataset.rows, 1)))  # fmt: skip
    names = ("steering_offset", "implement_side_draft")
    scores = {
        one.id: compute_programme_separation(residual_model, one, eg105(), (truth, competitor), names)
        for one in DRIVE_PROGRAMMES
    }
    assert scores["there-and-back"] < DECISIVE_LOSS < scores["implement-lifted"]
    drive = choose_next_drive(residual_model, fit, eg105(), {"steering_offset": competitor}, fit.settings)
    assert drive is not None and drive.separates == names and drive.decides
    seconds = {one.id: one.seconds for one in DRIVE_PROGRAMMES}
    assert drive.seconds == min(seconds[name] for name, score in scores.items() if score > DECISIVE_LOSS)
    assert drive.score == pytest.approx(scores[drive.id])
    assert choose_next_drive(residual_model, fit, eg105(), {"steering_offset": {}}, fit.settings) is None


def test_every_effect_says_itself_in_words() -> None:
    for entry in CATALOGUE:
        assert draw_hidden_effect(1, eg105(), entry.id).description[0].isupper()
