"""The words of an answer, notes beside it, demonstrations and progress."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.measured.benches import bench_of, eg105, knobs
from vehicle.effects import BY_ID, CATALOGUE, PATH, SPEED, check, neutral
from vehicle.measured.answer.demo import PLACE, draw_hidden, programme
from vehicle.measured.answer.diagnose import _Counter, _depends_on, _guilty, _with_rest
from vehicle.measured.answer.nextdrive import _score, next_drive
from vehicle.measured.answer.notes import _of_file, _of_logs
from vehicle.measured.answer.verdict import EQUIVALENT, NAMED, NOT_VISIBLE, Diagnosis, Finding, finite, listed
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.replay.drives import DRILLS
from vehicle.measured.thresholds import DECISIVE, SAME_ERROR
from vehicle.tractor import EffectSetting, Rest

REST = Rest(amounts={"push_to_east": 0.01}, speed_mps=(0.5, 2.0), angle_deg=(-10.0, 10.0))


def told(name: str, status: str, words: str = "Words.") -> Finding:
    return Finding(name, status, None, None, None, None, None, "", BY_ID[name].block, words)


def answer(*findings: Finding, **more: Any) -> Diagnosis:
    values: dict[str, Any] = {
        "names": ("a",), "rows_used": 1, "rows_gated": 0, "minutes": 1.0, "ground": "soil", "before": {}, "after": {},
        "floor": {}, "guilty_block": None, "block_error": {}, "findings": findings,
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
    assert answer(depends_on=("a", "b", "c")).headline.endswith("what the simulation gets wrong is a; b; and c.")
    assert answer(unexplained_share=0.4).headline.endswith("depends on nothing that was looked for.")
    assert answer(calibration={"wheel_slip": {"ratio": 0.1}}).headline.startswith("No cause found")
    assert answer(notes=("The tractor file has x already: ...",)).headline.startswith("Nothing found beyond")
    assert answer().headline.startswith("Nothing found: ")


def test_clauses_and_numbers() -> None:
    assert [listed(parts) for parts in ([], ["a"], ["a", "b"], ["a", "b", "c"])] == ["", "a", "a and b", "a; b; and c"]
    assert finite(1.5) == 1.5 and finite(float("inf")) is None and finite(float("nan")) is None


def test_the_guilty_block_is_that_of_the_name_the_set_or_the_dependence() -> None:
    set_of = [told("wheel_slip", EQUIVALENT), told("steering_offset", NOT_VISIBLE)]
    selection: Any = SimpleNamespace(unnamed=(SimpleNamespace(block="x"),))
    assert _guilty(["steering_offset"], set_of, selection) == PATH
    assert _guilty([], set_of, selection) == SPEED and _guilty([], [], selection) == "x"
    assert _guilty([], [], SimpleNamespace(unnamed=())) is None
    assert _guilty([], [], None) is None  # nothing is left that a block could be guilty of


def test_what_is_left_depends_on_unnamed_terms_or_on_the_rest_that_lowers_it() -> None:
    extension: Any = SimpleNamespace(ids=frozenset({"wheel_slip", "grip_by_speed", "grip_to_east", "grip_to_north"}))
    plain: Any = SimpleNamespace(unnamed=())
    words = ("a change of grip that depends on speed", "a change of grip that depends on the direction of travel")
    assert sorted(_depends_on(plain, extension)) == sorted(words)
    assert _depends_on(SimpleNamespace(unnamed=(SimpleNamespace(words="x"),)), extension) == ("x",)
    assert _depends_on(plain, SimpleNamespace(ids=frozenset({"wheel_slip"}))) == ()


def test_a_rest_of_the_file_stays_unless_the_logs_speak_against_it() -> None:
    plain, mine = eg105(), eg105().model_copy(update={"rest": REST})
    after = np.array([10.0])
    assert _with_rest(mine, plain, after * (SAME_ERROR - 0.01), after).rest is REST
    assert _with_rest(mine, plain, after * (SAME_ERROR + 0.01), after).rest is None
    newer = plain.model_copy(update={"rest": REST.model_copy(update={"on": False})})
    assert _with_rest(mine, newer, after, after) is newer and _with_rest(plain, plain, after, after) is plain


def test_progress_never_runs_past_its_estimate() -> None:
    seen: list[tuple[int, int]] = []
    count = _Counter(lambda done, total: seen.append((done, total)))
    for _ in range(150):
        count.step()
    count.finish()
    assert all(done + 20 <= total for done, total in seen[:-1]) and seen[0] == (1, 100) and seen[-1] == (170, 170)
    _Counter(None).step()


def test_notes_of_logs_say_what_was_missing() -> None:
    bench = bench_of("there-and-back", {})
    assert _of_logs([], bench) == ()
    bare = tuple(replace(one, wheel=None, target=None) for one in bench.course.stretches)
    lines = _of_logs([], replace(bench, course=replace(bench.course, stretches=bare)))
    assert [line.split(" was")[0] for line in lines] == ["No wheel angle", "No commanded speed"]


def test_notes_of_a_file_say_what_became_of_its_effects_and_its_rest() -> None:
    slip = EffectSetting(value={"ratio": 0.1})
    known = {"steering_offset": EffectSetting(value={"angle_deg": 1.0}), "wheel_slip": slip}
    mine = eg105().model_copy(update={"effects": known, "rest": REST})
    kept = answer(tractor=eg105().model_copy(update={"effects": {"wheel_slip": slip}, "rest": REST}))
    one, two = _of_file(mine, kept)
    assert "steering_offset, wheel_slip already" in one and one.endswith("show wheel_slip: kept as the file has it.")
    assert two == "The tractor file has a rest: kept, these logs do not speak against it."
    assert _of_file(mine, answer())[1].endswith("dropped, these logs speak against it.")
    newer = answer(tractor=eg105().model_copy(update={"rest": REST.model_copy(update={"on": False})}))
    assert _of_file(mine, newer)[1].endswith("replaced.")
    assert _of_file(eg105(), answer()) == ()


@given(st.integers(0, 10**6), st.sampled_from([None, *BY_ID]))
def test_a_demonstration_hides_what_a_tractor_can_have(seed: int, name: str | None) -> None:
    hidden = draw_hidden(seed, eg105(), name)
    assert hidden == draw_hidden(seed, eg105(), name) and (name is None or hidden.id == name)
    check(hidden.id, hidden.values)
    assert hidden.values != neutral(hidden.id, eg105().steering) and hidden.words.endswith(".")


def test_the_programme_of_a_demonstration_is_about_nine_minutes() -> None:
    seconds = [sum(piece[0] for piece in pieces) for _, _, pieces in programme()]
    assert sum(seconds) == pytest.approx(540.0, abs=60.0) and len({name for name, _, _ in programme()}) == 11
    assert PLACE[2] > 0.0


def test_lifting_the_implement_tells_an_offset_from_a_draft() -> None:
    """An offset turns the tractor always, a draft while the implement works: drives without both tell nothing."""
    truth = {"steering_offset": {"angle_deg": 2.0}}
    rival = {"implement_side_draft": {"curvature_per_m": 0.01}}
    bench = bench_of("there-and-back", truth)
    fit = Fit(((knobs("steering_offset"), np.array([2.0])),), bench.surprise(truth),
              np.zeros((5 * bench.course.rows, 1)))  # fmt: skip
    names = ("steering_offset", "implement_side_draft")
    scores = {one.id: _score(bench, one, eg105(), (truth, rival), names) for one in DRILLS}
    assert scores["there-and-back"] < DECISIVE < scores["implement-lifted"]
    drive = next_drive(bench, fit, eg105(), {"steering_offset": rival}, fit.settings)
    assert drive is not None and drive.separates == names and drive.decides
    seconds = {one.id: one.seconds for one in DRILLS}
    assert drive.seconds == min(seconds[name] for name, score in scores.items() if score > DECISIVE)
    assert drive.score == pytest.approx(scores[drive.id])
    assert next_drive(bench, fit, eg105(), {"steering_offset": {}}, fit.settings) is None


def test_every_effect_says_itself_in_words() -> None:
    for entry in CATALOGUE:
        assert draw_hidden(1, eg105(), entry.id).words[0].isupper()
