"""Durations, headlines and groups of refusals in words."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from reports.common.plan_records import Shortfall, UnworkedPiece
from reports.common.plan_results import PlanRanking, PlanResult
from reports.common.wording import (
    NO_BREAK,
    format_clock_after_start,
    format_duration,
    format_minutes,
    format_number,
    format_price,
    insert_non_breaking_spaces,
    join_list,
    replace_effect_ids,
)
from reports.plan.answer import write_answer
from reports.plan.figures import FIGURES, TABLE_DROPS
from reports.plan.plan_wording import (
    describe_largest_piece,
    describe_simulated_effects,
    format_ground_place,
    format_in_time_probability,
    format_unworked,
    list_plan_remarks,
)
from reports.plan.shortfall_wording import group_refusals


def list_told(ranking: PlanRanking) -> list[str]:
    """All sentences of the answer, as an explanation has them."""
    answer = write_answer(ranking)
    return [*answer.list_sentences(), *answer.details]


@pytest.mark.parametrize(
    ("seconds", "short", "thesis"),
    [
        (0.0, "0:00:00", "0:00"), (59.4, "0:00:59", "0:59"), (59.5, "0:01:00", "1:00"), (3599.6, "1:00:00", "60:00"),
        (4475.0, "1:14:35", "74:35"), (-90.0, "-0:01:30", "-1:30"), (None, "-", "-"), (float("nan"), "-", "-"),
        (float("inf"), "-", "-"),
    ],
)  # fmt: skip
def test_durations_by_hand(seconds: float | None, short: str, thesis: str) -> None:
    assert format_duration(seconds) == short
    assert format_minutes(seconds) == thesis


@given(st.integers(min_value=0, max_value=10**6))
def test_durations_read_back(seconds: int) -> None:
    read = 0
    for part in format_duration(float(seconds)).split(":"):
        read = read * 60 + int(part)
    mins, secs = format_minutes(float(seconds)).split(":")
    assert read == seconds == int(mins) * 60 + int(secs)


def test_numbers_have_no_negative_zero_prices_stay_short_and_lists_are_words() -> None:
    assert [format_number(-0.04, 1), format_number(float("nan"), 1)] == ["0.0", "-"]
    assert [format_price(4.925), format_price(999.99), format_price(12345.6)] == ["4.92", "1000", "12346"]
    lists = [join_list([]), join_list([1]), join_list([1, 3]), join_list([1, 3, 5], "or")]
    assert lists == ["none", "1", "1 and 3", "1, 3 or 5"]


def test_headline_with_a_deadline(ranking: PlanRanking) -> None:
    assert list_told(ranking) == [
        "3 tractors, split-field: done 08:29, 5.65",
        "98.7 % worked.",
        "Or 2 tractors: 09:03, +2.54; 5 tractors: 08:21, +1.24.",
        "It turns switch-back and is driven in 0:28:32.",
        "The deadline (09:00) can be met with 3 or 5 tractors, not with 1 or 2; the best plan is the cheapest of them.",
        "Fastest: 5 tractors, row-by-row.",
        "Cheapest: 1 tractor: 09:15, 0.73 cheaper.",
    ]
    late = replace(ranking, start="22:00", deadline="02:00", allowed_s=4 * 3600.0)
    assert write_answer(late).details[1].startswith("The deadline (02:00 next day) can be met with")


def test_sentence_and_table_of_all_plans_state_the_end_of_field_work(ranking: PlanRanking) -> None:
    """Not the way out after it, which the headline leaves out too; the details say how long the drive is."""
    plans = tuple(replace(plan, done_s=plan.time_s and plan.time_s - 60.0) for plan in ranking.plans)
    answer = write_answer(replace(ranking, plans=plans))
    assert answer.decision.endswith("done 08:28, 5.65") and answer.details[0].endswith("is driven in 0:28:32.")
    plans = tuple(replace(plan, meets_deadline=None) for plan in plans)
    free = replace(ranking, plans=plans, start=None, deadline=None, allowed_s=None, chosen=("split-field", 3))
    assert FIGURES["stated_end_s"].format(free.best) == "0:27:32"
    assert "stated_end_s" in TABLE_DROPS and write_answer(free).decision.endswith("done in 0:27:32, 5.65")


def test_headline_without_a_deadline_takes_the_knee(ranking: PlanRanking) -> None:
    """From 4,475 s with one tractor a second saves 750, less than half of 2,237.5."""
    plans = tuple(replace(plan, meets_deadline=None) for plan in ranking.plans)
    free = replace(ranking, plans=plans, start=None, deadline=None, allowed_s=None, prices_assumed=True)
    answer = write_answer(free)
    assert answer.decision == "1 tractor: done in 1:14:35, 4.92 (assumed prices)"
    assert answer.rule == "1 tractor; a fleet of 3 saves 46 min for 0.73."
    assert [sentence.split(":")[0] for sentence in answer.details] == [
        "It turns u and is driven in 1", "Fastest", "The best plan is also the cheapest.",
    ]  # fmt: skip


def test_headline_when_nobody_is_in_time(ranking: PlanRanking) -> None:
    plans = tuple(replace(plan, meets_deadline=False if plan.feasible else None) for plan in ranking.plans)
    late = replace(ranking, plans=plans, deadline="08:10", allowed_s=600.0, shortfalls=(Shortfall("late"),))
    assert list_told(late) == [
        "No plan is done by 08:10; the best is 11 min late.",
        "5 tractors, row-by-row: done 08:21, 6.89",
        "98.7 % worked.",
        "Or 3 tractors: 08:29, 1.24 cheaper.",
        "It turns omega and is driven in 0:20:53.",
        "Cheapest: 1 tractor: 09:15, 1.97 cheaper.",
    ]


def test_a_single_plan_is_not_called_the_cheapest(ranking: PlanRanking) -> None:
    plan = next(plan for plan in ranking.plans if plan.meets_deadline)
    for meets in (True, None):
        alone = replace(ranking, plans=(replace(plan, meets_deadline=meets),))
        assert not any("cheapest" in text.lower() for text in list_told(alone))


class TestWhatIsLeft:
    def test_the_best_plan_says_what_it_leaves_and_what_finishing_comes_to(self, leaving: PlanRanking) -> None:
        plans = tuple(replace(plan, meets_deadline=None) for plan in leaving.plans)
        quickest = plans[0].strategy, plans[0].tractors
        answer = write_answer(replace(leaving, plans=plans, deadline=None, allowed_s=None, chosen=quickest))
        assert answer.work == "80.0 % worked (0.38 ha left: 5 min and 1.72 of work, without ways there)."
        assert answer.ground == "The largest piece left, 0.12 ha, is at latitude 43.20000, longitude 141.75000."
        assert answer.details[1:] == (
            "At the plan's own rate, without ways there, finishing the missed 0.38 ha adds 5 min (field work done "
            "at 08:27) and 1.72.",
            "Cheapest: 1 tractor: 09:15, 3.15 cheaper, 90.0 % worked.",
        )

    def test_the_largest_piece_left_is_told_with_its_reason(self, leaving: PlanRanking) -> None:
        piece = UnworkedPiece(306.0, 12.4, -3.6, reason="between headland passes and tracks")
        best = replace(leaving.best, largest_missed=piece)
        assert describe_largest_piece(best) == (
            "The largest piece left is 306 m2 (between headland passes and tracks).",
            "The largest piece left is at x 12 m, y -4 m.",
        )
        assert describe_largest_piece(replace(best, spared_m2=best.missed_m2)) == ("", ""), (
            "nothing of it was to be worked"
        )

    def test_time_to_finish_is_told_of_the_ground_that_it_is_for(self, leaving: PlanRanking) -> None:
        """Not of what was left out on request, which no time is charged for."""
        best = leaving.best
        for spared_m2, told in (
            (best.missed_m2 - 212.0, "the 212 m2 of it that was to be worked adds"),
            (0.0, "the missed 0."),
        ):
            plans = tuple(replace(plan, spared_m2=spared_m2 if plan is best else 0.0) for plan in leaving.plans)
            assert f"finishing {told}" in " ".join(list_told(replace(leaving, plans=plans)))
        plans = tuple(replace(plan, spared_m2=plan.missed_m2 or 0.0) for plan in leaving.plans)
        assert "finishing" not in " ".join(list_told(replace(leaving, plans=plans)))

    def test_fastest_and_cheapest_are_those_of_the_finished_field(self, leaving: PlanRanking) -> None:
        little = replace(leaving.plans[4], worked_pct=30.0, missed_m2=13_230.0, finished_s=14_917.0, finished_cost=16.4)
        plans = (*leaving.plans[:4], little, *leaving.plans[5:])
        sentences = list_told(replace(leaving, plans=plans))
        assert sentences[-1].startswith("Cheapest: 1 tractor: 09:24")
        quick = replace(leaving.plans[1], time_s=900.0, finished_s=4500.0, missed_m2=15_120.0, worked_pct=20.0)
        sentences = list_told(replace(leaving, plans=(leaving.plans[0], quick, *leaving.plans[2:])))
        assert next(s for s in sentences if s.startswith("Fastest")).startswith("Fastest: 5 tractors, row-by-row")

    def test_finishing_too_late_for_the_deadline_is_said(self, leaving: PlanRanking) -> None:
        late = "Finishing the missed 0.19 ha as well takes longer than the deadline allows."
        assert write_answer(replace(leaving, plans=leaving.plans[2:3], allowed_s=1800.0)).faults == (late,)
        assert late not in write_answer(leaving).faults

    def test_a_plan_that_could_finish_in_time_is_best_and_called_so(self, leaving: PlanRanking) -> None:
        cheap = replace(leaving.plans[3], time_s=3500.0, meets_deadline=True, finished_s=3889.0, finished_cost=1.0)
        ranking = replace(leaving, plans=(*leaving.plans[:3], cheap))
        assert ranking.best is leaving.plans[2]
        assert "the best plan is the cheapest that could finish the field by then." in " ".join(list_told(ranking))

    @pytest.mark.parametrize(
        ("m2", "pct", "words"),
        [(8300.0, 79.4, "0.83 ha (21 %)"), (450.0, 96.35, "450 m2 (3.7 %)"), (3.0, 99.99, "3 m2 (under 0.1 %)"),
         (0.3, 99.9, None), (None, 98.0, None)],
    )  # fmt: skip
    def test_how_much_in_words(self, leaving: PlanRanking, m2: float | None, pct: float, words: str | None) -> None:
        assert format_unworked(replace(leaving.plans[0], missed_m2=m2, worked_pct=pct)) == words

    def test_a_place_on_the_earth_or_in_the_field(self) -> None:
        assert format_ground_place(UnworkedPiece(5.0, 12.4, -3.6)) == "x 12 m, y -4 m"
        on_the_earth = UnworkedPiece(5.0, 12.4, -3.6, 9.88618, 56.463781)
        assert format_ground_place(on_the_earth) == "latitude 56.46378, longitude 9.88618"


def test_a_value_stays_with_the_word_before_it() -> None:
    text = f"cost{NO_BREAK}5.65 (at{NO_BREAK}08:29) on a, b with{NO_BREAK}2, 3 or{NO_BREAK}5"
    assert insert_non_breaking_spaces(text.replace(NO_BREAK, " ")) == text


def test_effects_are_told_by_their_words_with_ids_and_units(ranking: PlanRanking) -> None:
    effects = {"steering_offset": {"angle_deg": 1.0}, "cross_slope_drift": {"ratio": 0.031, "bearing_deg": 90.0},
               "discrepancy_model": {"grip_to_east": 0.1}}  # fmt: skip
    assert describe_simulated_effects(replace(ranking, tractor_effects=effects)) == (
        "Simulated with what measured logs showed of this tractor: steering offset (steering_offset): 1 deg; cross "
        "slope drift (cross_slope_drift): 0.031 m/m, bearing 90 deg; a discrepancy model."
    )
    assert describe_simulated_effects(ranking) is None
    assert (
        replace_effect_ids("1 deg of gnss_latency, not my_gnss_latency") == "1 deg of GNSS latency, not my_gnss_latency"
    )


def test_headline_when_nothing_works(ranking: PlanRanking) -> None:
    refused_only = replace(ranking, plans=ranking.plans[6:])
    assert list_told(refused_only) == [
        "No plan works: all 4 were refused, 2 of them because: Turning radius 4.10 m needs 8.20 m, "
        "rows are 10.00 m apart (figures of the first)."
    ]
    assert list_told(replace(ranking, plans=()))[0].startswith("No plan was tried")
    assert group_refusals(ranking.plans[6:])[0].members == "row-by-row (u) with 7 and 9"


@pytest.mark.parametrize(
    ("reasons", "words"),
    [
        (["Too narrow."], "the only one was refused because: Too narrow."),
        (["Too narrow."] * 2, "both were refused because: Too narrow."),
        (["Too narrow.", "Too short."], "both were refused, one of them because: Too narrow."),
        (["Too narrow."] * 3, "all 3 were refused because: Too narrow."),
        (["Too narrow.", "Too short.", "Too short."], "all 3 were refused, 2 of them because: Too short."),
        (["a", "b", "c"], "all 3 were refused, one of them because: a."),
    ],
)
def test_how_many_were_refused_and_why(ranking: PlanRanking, reasons: list[str], words: str) -> None:
    plans = tuple(PlanResult("s", 1, "u", False, reason) for reason in reasons)
    assert list_told(replace(ranking, plans=plans)) == [f"No plan works: {words}"]


def test_remarks_name_the_strategy_and_the_counts_or_are_one_line_with_a_count(ranking: PlanRanking) -> None:
    first, *rest = ranking.plans
    plans = [*(replace(first, tractors=count, remarks=("it waits",)) for count in (5, 2)), *rest]
    assert list_plan_remarks(plans) == ["row-by-row with 2 and 5: it waits."] and list_plan_remarks(rest) == []
    remarks = (("it waits", "2 m are near"), ("it waits", "3 m are near"), ("it waits",))
    plans = [replace(plan, remarks=own) for plan, own in zip(ranking.plans, remarks, strict=False)]
    assert list_plan_remarks(plans) == ["3 plans: it waits.", "2 plans, such as row-by-row with 5: 2 m are near."]


def test_the_cheapest_is_told_once(ranking: PlanRanking) -> None:
    in_time = replace(ranking, plans=ranking.plans[:3])
    assert write_answer(in_time).details[1:] == (
        "The deadline (09:00) can be met with 3 or 5 tractors; the best plan is the cheapest of them.",
        "Fastest: 5 tractors, row-by-row.",
        "The best plan is also the cheapest.",
    )
    late = list_told(replace(ranking, plans=ranking.plans[4:5], shortfalls=(Shortfall("late"),)))
    assert late[0].startswith("No plan is done by 09:00; the best is ")
    assert late[-1].startswith("It turns"), "of one plan it says nothing"


def test_money_of_draws_is_told_as_it_was_chosen_by(ranking: PlanRanking) -> None:
    plans = tuple(
        replace(plan, meets_deadline=None, paid_cost=50.0 + plan.tractors, expected_cost=70.0 - plan.tractors,
                finished_cost=(plan.cost or 0.0) + 1.25)
        for plan in ranking.plans[:5]
    )  # fmt: skip
    drawn = replace(ranking, plans=plans, deadline=None, allowed_s=None, currency="EUR", samples=100,
                    money_sentences=("Money.",), chosen=("split-field", 1))  # fmt: skip
    answer = write_answer(drawn)
    assert answer.decision.endswith(", 69 EUR") and answer.details[0] == "Money."
    assert answer.details[-1].startswith("Fastest and cheapest: 5 tractors, row-by-row")
    best = write_answer(replace(drawn, chosen=("row-by-row", 5)))
    assert best.details[-1] == "The best plan is also the cheapest."


def test_a_probability_of_few_draws_is_from_and_to(ranking: PlanRanking) -> None:
    plan = replace(ranking.plans[0], finish_probability=0.77, finish_probability_interval=(0.678, 0.842))
    assert format_in_time_probability(plan) == "68-84"
    assert format_in_time_probability(replace(plan, finish_probability_interval=(0.762, 0.778))) == "77"
    assert (
        format_in_time_probability(replace(plan, finish_probability=0.999, finish_probability_interval=None)) == ">99"
    )
    assert format_in_time_probability(replace(plan, finish_probability=None, finish_probability_interval=None)) == "-"


def test_clock_times_after_the_start(ranking: PlanRanking) -> None:
    assert format_clock_after_start(ranking, 3725.0) == "09:02"
    assert format_clock_after_start(replace(ranking, start="23:30"), 3600.0) == "00:30 next day"
    assert format_clock_after_start(replace(ranking, start="soon"), 3600.0) is None


def test_of_reasons_why_no_plan_works_one_whose_fix_was_refused_is_told_last(ranking: PlanRanking) -> None:
    reason = "Too few tracks; use split-field."
    rows = [PlanResult(name, 3, "u", False, reason, in_formation=True) for name in ("a-row", "b-col")]
    for in_formation, told in ((False, "one of them because: No work"), (True, "2 of them because: Too few tracks")):
        split = PlanResult(
            "split", 3, "u", False, "No work for tractor 3; use fewer tractors.", in_formation=in_formation
        )
        (sentence,) = list_told(replace(ranking, plans=(*rows, split)))
        assert told in sentence


@given(st.lists(st.tuples(st.sampled_from("ab"), st.integers(1, 9)), max_size=20))
def test_every_refusal_is_in_one_group(entries: list[tuple[str, int]]) -> None:
    plans = [PlanResult("s", count, "u", False, f"{word} {count} m") for word, count in entries]
    groups = group_refusals(plans)
    assert sorted(id(plan) for group in groups for plan in group.plans) == sorted(id(plan) for plan in plans)
    assert len(groups) == len({word for word, _ in entries})
    assert all(group.has_similar_reasons == (len({plan.tractors for plan in group.plans}) > 1) for group in groups)
    sizes = [len(group.plans) for group in groups]
    assert sizes == sorted(sizes, reverse=True)
