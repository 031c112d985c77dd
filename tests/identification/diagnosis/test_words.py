"""The words of an answer, notes beside it, demonstrations and progress."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.identification.analytic_drives import circle, log, simulated
from vehicle.identification.diagnosis.demo_logs import DEMO_PLACE, build_programme, draw_hidden_effect
from vehicle.identification.diagnosis.diagnose import _ProgressCounter
from vehicle.identification.diagnosis.log_notes import describe_clocks, describe_file_corrections, describe_logs
from vehicle.identification.diagnosis.results import EQUIVALENT, NAMED, Diagnosis, Finding, Hint, join_clauses
from vehicle.identification.replay.drive_segments import build_dataset
from vehicle.model.effects import CATALOGUE, EFFECTS_BY_ID, check_effect, get_neutral_values
from vehicle.model.tractor import DiscrepancyModel, EffectSetting, load_tractor

EG105 = load_tractor("eg105")
REST = DiscrepancyModel(amounts={"push_to_east": 0.01}, speed_mps=(0.5, 2.0), angle_deg=(-10.0, 10.0))


def told(name: str, status: str, words: str = "Words.") -> Finding:
    return Finding(name, status, description=words)


def answer(*findings: Finding, **more: Any) -> Diagnosis:
    values: dict[str, Any] = {
        "names": ("a",), "rows_used": 1, "rows_gated": 0, "minutes": 1.0, "ground": "soil", "before": {}, "after": {},
        "noise_floor": {}, "guilty_block": None, "block_error": {}, "findings": findings,
        "named": tuple(one.id for one in findings if one.status == NAMED), "unexplained_share": 0.0, "depends_on": (),
        "next_drive": None, "tractor": EG105, "calibration": {}, "curve": None,
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
    lone = replace(one, exchange="these logs cannot tell it from steering gain")
    assert answer(lone).headline == "It may be, though these logs cannot tell it from steering gain: This."
    assert answer(depends_on=("a", "b", "c")).headline.endswith("the simulation misses a; b; and c.")
    assert answer(unexplained_share=0.4).headline.endswith("depends on none of the quantities examined.")
    hint = Hint("speed", "heading", None, "Errors of the headings go together with speed.")
    assert answer(unexplained_share=0.4, hints=(hint,)).headline.endswith(f"explains these logs. {hint.words}")
    assert answer(calibration={"wheel_slip": {"ratio": 0.1}}).headline.startswith("No cause found")
    assert answer(file_effects=("wheel_slip",)).headline.startswith("Nothing found beyond")
    assert answer().headline.startswith("Nothing found: ")


def test_clauses_and_numbers() -> None:
    assert [join_clauses(parts) for parts in ([], ["a"], ["a", "b"], ["a", "b", "c"])] == [
        "",
        "a",
        "a and b",
        "a; b; and c",
    ]


def test_progress_never_runs_past_its_estimate() -> None:
    seen: list[tuple[int, int]] = []
    count = _ProgressCounter(lambda done, total: seen.append((done, total)))
    for _ in range(150):
        count.count_step()
    count.report_completion()
    assert all(done + 20 <= total for done, total in seen[:-1]) and seen[0] == (1, 60) and seen[-1] == (170, 170)
    _ProgressCounter(None).count_step()


def test_notes_of_logs_say_what_was_missing() -> None:
    dataset = simulated("there-and-back", {})
    assert describe_logs([], dataset) == ()
    bare = tuple(replace(one, wheel=None, target=None) for one in dataset.segments)
    lines = describe_logs([], replace(dataset, segments=bare))
    assert [line.split(" was")[0] for line in lines] == ["No wheel angle", "No commanded speed"]


def test_notes_of_a_file_say_what_became_of_its_effects_and_its_rest() -> None:
    slip = EffectSetting(value={"ratio": 0.1})
    known = {"steering_offset": EffectSetting(value={"angle_deg": 1.0}), "wheel_slip": slip}
    mine = EG105.model_copy(update={"effects": known, "discrepancy_model": REST})
    kept = answer(tractor=EG105.model_copy(update={"effects": {"wheel_slip": slip}, "discrepancy_model": REST}))
    one, two = describe_file_corrections(mine, kept)
    assert "already has steering_offset, wheel_slip;" in one and one.endswith(
        "show wheel_slip; the value of the file was kept."
    )
    assert two == "The tractor file has a discrepancy model: kept, as these logs do not contradict it."
    assert describe_file_corrections(mine, answer())[1].endswith("dropped, as these logs contradict it.")
    newer = answer(tractor=EG105.model_copy(update={"discrepancy_model": REST.model_copy(update={"on": False})}))
    assert describe_file_corrections(mine, newer)[1].endswith("replaced.")
    assert describe_file_corrections(EG105, answer()) == ()


@given(st.integers(0, 10**6), st.sampled_from([None, *EFFECTS_BY_ID]))
def test_a_demonstration_hides_what_a_tractor_can_have(seed: int, name: str | None) -> None:
    hidden = draw_hidden_effect(seed, EG105, name)
    assert hidden == draw_hidden_effect(seed, EG105, name) and (name is None or hidden.id == name)
    check_effect(hidden.id, hidden.values)
    assert hidden.values != get_neutral_values(hidden.id, EG105.steering) and hidden.description.endswith(".")


def test_the_programme_of_a_demonstration_is_about_nine_minutes() -> None:
    seconds = [sum(piece[0] for piece in pieces) for _, _, pieces in build_programme()]
    assert sum(seconds) == pytest.approx(540.0, abs=60.0) and len({name for name, _, _ in build_programme()}) == 11
    assert DEMO_PLACE[2] > 0.0


def test_every_effect_says_itself_in_words() -> None:
    for entry in CATALOGUE:
        assert draw_hidden_effect(1, EG105, entry.id).description[0].isupper()


def said(found: dict[str, dict[str, float] | None], *seconds: float) -> list[str]:
    """What is said of clocks, of logs that last so long, where values were found of some effects."""
    logs: Any = [SimpleNamespace(time_s=np.array([5.0, 5.0 + one]), used=np.ones(2, dtype=bool)) for one in seconds]
    answer: Any = SimpleNamespace(findings=[SimpleNamespace(id=name, value=value) for name, value in found.items()])
    return describe_clocks(logs, answer)


def test_a_time_from_short_logs_takes_one_clock_for_granted() -> None:
    late: dict[str, dict[str, float] | None] = {"gnss_latency": {"time_s": 0.2}, "steering_dead_time": None}
    (told,) = said(late, 60.0, 180.0)
    assert told.startswith("1 of 2 logs are too short (under 100 s)") and "result for gnss_latency assumes" in told
    (told,) = said({**late, "steering_dead_time": {"time_s": 0.1}}, 60.0)
    assert told.startswith("The log is too short") and "gnss_latency and steering_dead_time" in told


@pytest.mark.parametrize("found", [{"gnss_latency": None}, {"steering_offset": {"angle_deg": 1.0}}])
def test_without_a_time_nothing_is_said_of_clocks(found: dict[str, dict[str, float] | None]) -> None:
    assert said(found, 60.0) == [] and said({"gnss_latency": {"time_s": 0.2}}, 180.0) == []


def test_a_log_without_heading_is_said_also_where_the_part_has_none_of_it() -> None:
    logs: Any = [log(circle(0.0)), log(circle(0.0).drop(columns="heading_deg"))]
    course = build_dataset(logs[:1])
    said_of = [[line for line in describe_logs(some, course) if "heading" in line] for some in (logs[:1], logs)]
    assert said_of == [[], ["Some logs have no heading; the course of the positions is used instead."]]
