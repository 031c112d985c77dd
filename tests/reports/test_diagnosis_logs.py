"""What a diagnosis says of the logs: faults that begin, columns that are late, runs, and runs held out.

The first screens are beside stored ones (tests/reports/screens); test_first_screens says how these are renewed.
"""

import json
from dataclasses import replace

import pytest

from reports.diagnosis.page import build_diagnosis_view
from reports.diagnosis.sentences import MOST_RUNS, describe_columns, describe_remaining_error, describe_unsaved
from reports.diagnosis.tables import build_diagnosis_screen, format_diagnosis_json
from tests.printing import assert_as_stored, print_text
from tests.reports.test_diagnosis import CHANGED, OFFSET, both, diagnosis, flat, in_model, printed
from vehicle.identification.diagnosis.results import (
    LIKELY,
    NAMED,
    ColumnTiming,
    Diagnosis,
    Hint,
    HoldoutResult,
    HoldoutRun,
    ParameterLaw,
    RunCheck,
)
from vehicle.identification.logs.schema import LogFault
from vehicle.identification.replay.horizon_errors import HorizonError

NAMES = tuple(f"run{number}" for number in range(1, 13))
RUNS = tuple(RunCheck(name, 10.0 + number, 1.0 + number) for number, name in enumerate(NAMES))
ODD = RunCheck("run4", 9.0, 2.0, True, "turns 15 % less than the others")
FAULT = LogFault("steering_loose", "run7", 812.0, None, "from 13:53:20 the wheel does not follow the commands")
STALE = ColumnTiming(
    "steering", 0.3, 2.0, None, None, 0.87, "steering is 0.3 s late and held for up to 2 s (87 % of rows are stale)"
)
SMOOTH = ColumnTiming("heading", filter_s=0.6, clock_offset_s=-0.12)
HINT = Hint("time of day", "heading", None, "The error depends on the time of day: look at the heading")
LAW = ParameterLaw("over_day", {"ratio_per_hour": 0.02}, "it grows by 0.02 an hour over the day.")
REASONS = {"shuttle in neutral": 58, "position jumps faster than 20 m/s": 2600}
REASON = "What fits these logs best raises an error on runs that had no part in it, so nothing is saved."


def hold_out(scale: float, helps: bool, asked: bool = True) -> HoldoutResult:
    before = {h: HorizonError(h, 2.0 * h, 0.1 * h) for h in (1.0, 5.0, 10.0, 20.0)}
    after = {h: replace(error, cross_cm=scale * h) for h, error in before.items()}
    runs = tuple(HoldoutRun(name, before, after) for name in ("run2", "run9"))
    return HoldoutResult(("run2", "run9"), before, after, helps, runs, "Held out, as asked: run2, run9.", asked)


FAULTY = diagnosis(OFFSET, faults=(FAULT,), names=NAMES, runs=RUNS, rows_gated=2658, rows_gated_by_reason=REASONS)
LATE = diagnosis(in_model("grip_drift", LIKELY, 0.05), columns=(STALE, SMOOTH), hints=(HINT,))
HARMFUL = diagnosis(OFFSET, names=NAMES[:5], runs=(ODD, *RUNS[:2]), holdout=hold_out(2.0, False), tractor=CHANGED)
SCREENS = {"diagnosis-fault": FAULTY, "diagnosis-columns": LATE, "diagnosis-holdout": HARMFUL}


def show_screen(what: Diagnosis, width: int = 80) -> str:
    return print_text(build_diagnosis_screen(what), width)


@pytest.mark.parametrize("width", [60, 80, 120])
@pytest.mark.parametrize("name", SCREENS)
def test_first_screens_are_as_stored(name: str, width: int) -> None:
    assert_as_stored(name, build_diagnosis_screen(SCREENS[name]), width)


def test_a_usual_diagnosis_fits_one_screen() -> None:
    four = {h: HorizonError(h, 2.0 * h, 0.1 * h) for h in (1.0, 5.0, 10.0, 20.0)}
    what = diagnosis(
        OFFSET, names=NAMES, runs=RUNS, before=four, after=four, noise_floor=four, tractor=CHANGED, notes=("A.", "B."),
        guilty_block="speed", holdout=hold_out(0.1, True, asked=False),
    )  # fmt: skip
    assert len(show_screen(what).splitlines()) <= 24


class TestFaults:
    def test_come_first_with_run_and_time(self) -> None:
        said = "run7: from 13:53:20 the wheel does not follow the commands."
        for text in (flat(show_screen(FAULTY)), *both(FAULTY)):
            assert text.index(said) < text.index("The wheels stand 1.0 degrees")
        found = json.loads(format_diagnosis_json(FAULTY))
        assert found["verdict"].startswith(said) and build_diagnosis_view(FAULTY).summary().startswith(said)
        assert found["faults"] == [
            {"id": "steering_loose", "run": "run7", "from_s": 812.0, "to_s": None, "words": FAULT.words}
        ]
        named = replace(FAULT, words="from 13:53:20 the wheel of run7 does not follow.")
        assert named.sentence == "From 13:53:20 the wheel of run7 does not follow.", "a run is not told twice"

    def test_nothing_else_is_not_nothing(self) -> None:
        what = diagnosis(faults=(FAULT,))
        assert "Nothing else found" in what.headline and "Nothing found" not in what.headline
        assert diagnosis().headline.startswith("Nothing found")

    def test_nothing_beside_columns_stands_alone(self) -> None:
        for columns, said in (("steering_command",), "the steering command is"), (("position", "heading"),
                             "the position and the heading are"):  # fmt: skip
            what = diagnosis(columns=tuple(ColumnTiming(column, hold_s=0.2) for column in columns))
            assert what.headline.startswith(f"Nothing found apart from how {said} logged: as far as")


class TestColumns:
    def test_stand_before_the_causes_with_sizes(self) -> None:
        for text in (flat(show_screen(LATE)), *both(LATE)):
            places = [
                text.index(part)
                for part in (
                    "Steering is 0.3 s late and held for up to 2 s (87 % of rows are stale).",
                    "Heading: low-passed by 0.6 s, stamped -0.12 s by another clock.", "No cause is certain.",
                    "The error depends on the time of day: look at the heading.",
                )
            ]  # fmt: skip
            assert places == sorted(places)

    def test_are_a_table_and_objects(self) -> None:
        rows = [line.split() for line in printed(LATE).splitlines()]
        assert ["steering", "0.30", "2.00", "-", "-", "87", "%"] in rows
        told = json.loads(format_diagnosis_json(LATE))
        steering, heading = told["columns"]
        assert steering["hold_s"] == 2.0 and steering["filter_s"] is None and steering["stale_share"] == 0.87
        assert (heading["column"], heading["filter_s"], heading["clock_offset_s"]) == ("heading", 0.6, -0.12)
        hint = {"depends_on": "time of day", "instrument": "heading", "block": None, "words": HINT.words}
        assert told["hints"] == [hint]

    def test_what_the_verdict_says_is_no_hint(self) -> None:
        twice = replace(HINT, words="The error looks like a push that depends on time.")
        what = diagnosis(depends_on=("a push that depends on time",), hints=(twice, HINT), unexplained_share=0.5)
        for text in (flat(show_screen(what)), *both(what)):
            assert "The error looks like" not in text and "look at the heading" in text
        assert len(json.loads(format_diagnosis_json(what))["hints"]) == 2


class TestRuns:
    def test_worst_first_and_few(self) -> None:
        lines = printed(FAULTY).splitlines()
        first = next(number for number, line in enumerate(lines) if line.startswith("Error of each run"))
        table = [line.split() for line in lines[first + 2 : first + 3 + MOST_RUNS]]
        assert [row[0] for row in table] == [*reversed(NAMES[-MOST_RUNS:]), "..."]
        assert table[0] == ["run12", "21.0", "12.0"] and table[-1] == ["...", "4", "more"]
        found = json.loads(format_diagnosis_json(FAULTY))["runs"]
        assert [run["name"] for run in found] == list(NAMES) and found[3]["error_after_cm"] == 4.0

    def test_what_is_unlike_the_others_comes_before_the_worst(self) -> None:
        for text in (flat(show_screen(HARMFUL)), *both(HARMFUL)):
            assert "run4: turns 15 % less than the others." in text
        assert "worst first: run4 9.0 to 2.0; run2 11.0 to 2.0; run1 10.0 to 1.0." in flat(show_screen(HARMFUL))

    def test_of_runs_without_errors_only_names_are_known(self) -> None:
        found = json.loads(format_diagnosis_json(diagnosis()))["runs"]
        told = [(run["name"], run["error_after_cm"], run["unlike"]) for run in found]
        assert told == [("a", None, False), ("b", None, False)]

    def test_the_reason_for_most_rows_left_out_stands_at_the_top(self) -> None:
        for text in (flat(show_screen(FAULTY)), *both(FAULTY)):
            assert "2658 left out (2600: position jumps faster than 20 m/s)" in text
        for text in both(diagnosis(rows_gated_by_reason={"shuttle in neutral": 3})):
            assert "3 left out (shuttle in neutral)" in text
        assert json.loads(format_diagnosis_json(FAULTY))["rows_gated_by_reason"] == REASONS


class TestHeldOut:
    def test_errors_by_horizon_and_by_run(self) -> None:
        text = printed(HARMFUL, 100)
        rows = [line.split() for line in text.splitlines()]
        assert ["20", "s", "20.0", "40.0", "2.00", "40.0", "40.0", "2.00"] in rows
        assert ["run9", "11.2", "14.1"] in rows
        for text in both(HARMFUL):
            assert "Error on runs held out over pieces of 5 s: 11.18 cm before, 14.14 cm after" in text
        found = json.loads(format_diagnosis_json(HARMFUL))["holdout"]
        assert found["runs"] == ["run2", "run9"] and found["helps"] is False and found["is_requested"] is True
        assert found["after"]["20"]["cross_cm"] == 40.0 and [run["name"] for run in found["by_run"]] == ["run2", "run9"]

    def test_what_does_not_help_is_not_offered(self) -> None:
        reason = describe_unsaved(HARMFUL)
        assert "does not lower the error on runs held out" in reason and not HARMFUL.is_savable
        for text in (flat(show_screen(HARMFUL)), *both(HARMFUL)):
            assert reason in text and "The tractor file gets" not in text
        assert json.loads(format_diagnosis_json(HARMFUL))["unsaved_reason"] == reason

    def test_what_helps_or_changes_nothing_is_offered(self) -> None:
        better, same = (replace(HARMFUL, holdout=hold_out(scale, scale < 1.0)) for scale in (0.5, 1.0))
        assert better.is_savable and same.is_savable and describe_unsaved(better) == ""
        assert "it helps there" in flat(show_screen(better)) and "nothing was added" in flat(show_screen(same))
        assert "The tractor file gets: steering offset" in flat(show_screen(better))
        assert json.loads(format_diagnosis_json(better))["unsaved_reason"] is None

    def test_the_own_check_of_a_diagnosis_speaks_without_being_asked(self) -> None:
        what = replace(HARMFUL, holdout=hold_out(0.5, True, asked=False), unsaved_reason="it harms half of the logs")
        assert not what.is_savable and "It harms half of the logs." in flat(show_screen(what))
        assert "held out" not in build_diagnosis_view(what).summary()
        assert "held out" in build_diagnosis_view(HARMFUL).summary()

    def test_no_reason_is_told_for_saving_nothing_where_nothing_was_found(self) -> None:
        found, nothing = diagnosis(OFFSET, unsaved_reason=REASON), diagnosis(unsaved_reason=REASON)
        for what, is_told in ((found, True), (nothing, False)):
            assert [REASON in text for text in (flat(show_screen(what)), *both(what))] == [is_told] * 3
        assert describe_unsaved(nothing) == REASON  # for --save


class TestLaws:
    def test_stand_in_the_sentence_of_their_effect(self) -> None:
        what = diagnosis(replace(OFFSET, law=LAW))
        said = "straight ahead. It grows by 0.02 an hour over the day."
        for text in (flat(show_screen(what)), *both(what)):
            assert said in text
        found = next(one for one in json.loads(format_diagnosis_json(what))["effects"] if one["law"])
        assert found["id"] == "steering_offset" and found["law"]["kind"] == "over_day"

    def test_what_is_constant_or_said_in_the_description_needs_no_word(self) -> None:
        for law in (None, replace(LAW, kind="constant")):
            assert replace(OFFSET, law=law).sentence == OFFSET.description
        twice = replace(OFFSET, description=f"It stands. {LAW.words}", law=LAW)
        assert twice.sentence.count("over the day") == 1


def test_how_intervals_came_about_is_told() -> None:
    what = diagnosis(OFFSET, interval_note="intervals include the error of the model")
    assert all("Intervals include the error of the model." in text for text in both(what))
    assert json.loads(format_diagnosis_json(what))["interval_note"] == what.interval_note


def test_a_column_that_the_verdict_tells_is_not_told_twice() -> None:
    late = in_model("clock_offset_speed", NAMED, 0.16, description="The measured speeds are stamped 0.16 s too late.")
    column = ColumnTiming("speed", clock_offset_s=0.16, words=f"{late.sentence} run1: speed_mps reads 40 % more.")
    found = diagnosis(late, columns=(column, replace(STALE, words="steering is late.")))
    assert describe_columns(found) == ["Run1: speed_mps reads 40 % more.", "Steering is late."]
    assert flat(printed(found, 100)).count(late.sentence) == 1


def test_an_error_above_its_noise_is_not_told_as_noise() -> None:
    """1.4 cm of 1.2 may be chance; 0.7 degrees of 0.39 are not."""
    noise, error = HorizonError(1.2, 2.5, 0.39), HorizonError(1.4, 1.8, 0.7)
    for above, words in (((), "in all together."), ((10.0, 20.0), "in all together only over pieces of 10 and 20 s.")):
        clear = diagnosis(after={5.0: error}, noise_floor={5.0: noise}, above_noise_s=above)
        told = " ".join(describe_remaining_error(clear))
        assert "above the noise in heading, but " in told and words in told
    quiet = diagnosis(after={5.0: replace(error, heading_deg=0.45)}, noise_floor={5.0: noise})
    assert describe_remaining_error(quiet)[0].endswith("is no more than noise.")
