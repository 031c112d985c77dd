"""What a scenario accepts, and how it refuses: value, rule and fix in one sentence."""

import math
import re
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import HeadlandError
from planner.cli.common.options import get_option_name
from planner.errors import RequestError, mark_parameter, suggest_name
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.request.option_texts import format_clock, parse_clock, parse_counts, parse_strategies
from planner.request.plan_request import PlanRequest
from tests.examples import count_examples

QUICK = settings(max_examples=count_examples(60))


class TestCounts:
    @pytest.mark.parametrize(
        ("text", "counts"),
        [("3", (3,)), ("1-6", (1, 2, 3, 4, 5, 6)), ("1,3,5-7", (1, 3, 5, 6, 7)), (" 2 , 2-3", (2, 3)), ("50", (50,))],
    )
    def test_are_read_sorted_and_once_each(self, text: str, counts: tuple[int, ...]) -> None:
        assert parse_counts(text) == counts

    @pytest.mark.parametrize("text", ["", "x", "1,,2", "-1", "1.5", "1-", "3;4", "two", "1 2", "\u0663\u066b"])
    def test_garbled_text_is_quoted(self, text: str) -> None:
        with pytest.raises(RequestError, match="is not a count; write for instance"):
            parse_counts(text)

    def test_backwards_and_beyond(self) -> None:
        with pytest.raises(RequestError, match=r"'6-1' runs backwards; write 1-6"):
            parse_counts("6-1")
        with pytest.raises(RequestError, match="99999999999999 tractors cannot be planned; use 1 to 50"):
            parse_counts("1-99999999999999")

    @QUICK
    @given(st.sets(st.integers(1, 50), min_size=1))
    def test_round_trip(self, counts: set[int]) -> None:
        assert parse_counts(",".join(map(str, counts))) == tuple(sorted(counts))


class TestClock:
    @QUICK
    @given(st.integers(0, 23), st.integers(0, 59))
    def test_round_trip(self, hour: int, minute: int) -> None:
        assert format_clock(parse_clock(f"{hour:02d}:{minute:02d}", "start_s")) == f"{hour:02d}:{minute:02d}"

    @pytest.mark.parametrize("text", ["24:00", "12:60", "noon", "13", "1:2", "-1:00", "13:00:00", "", "13.00"])
    def test_refuses_what_is_no_time(self, text: str) -> None:
        with pytest.raises(RequestError, match=r"deadline_s .* is not a time of day; write hh:mm"):
            parse_clock(text, "deadline_s")

    def test_allowed_time_by_hand(self) -> None:
        assert PlanRequest("f", start_s=13 * 3600, deadline_s=17 * 3600 + 60).time_limit_s == 4 * 3600 + 60
        assert PlanRequest("f", start_s=13 * 3600).time_limit_s is None

    def test_a_deadline_past_midnight_is_on_the_next_day(self) -> None:
        assert PlanRequest("f", start_s=22 * 3600, deadline_s=2 * 3600).time_limit_s == 4 * 3600
        assert PlanRequest("f", start_s=60, deadline_s=0).time_limit_s == 24 * 3600 - 60


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"tractors": (0,)}, "0 tractors cannot be planned; use 1 to 50"),
        ({"tractors": (1, 51)}, "51 tractors cannot be planned"),
        ({"tractors": ()}, "No tractor count is given"),
        ({"strategies": ()}, "No strategy is given"),
        ({"strategies": ("row-by-rov",)}, "did you mean 'row-by-row'"),
        ({"strategies": ("columns",)}, "'columns' is unknown"),
        ({"turn": "omga"}, "did you mean 'omega'"),
        ({"width_m": 0.0}, "width_m.* m; use 0.5 to 100 m"),
        ({"width_m": -1.0}, "width_m.* m; use 0.5 to 100 m"),
        ({"width_m": math.nan}, "width_m"),
        ({"width_m": math.inf}, "width_m. is inf m; use 0.5 to 100 m"),
        ({"tractors": 3}, "tractors is 3; give whole numbers in a tuple"),
        ({"start_s": True}, "start_s is True; give a whole number"),
        ({"gnss_table": "table.csv"}, "gnss_table is used with gnss alone"),
        ({"clearance_m": 0.0}, "clearance_m.* is 0 m; use 0.05 to 10 m"),
        ({"clearance_m": math.nan}, "clearance_m.* is nan m"),
        ({"margin_m": -0.1}, "margin_m.* is -0.1 m; use 0 to 100 m"),
        ({"margin_m": math.inf}, "margin_m.* is inf m"),
        ({"clearance_m": 11.0}, "clearance_m.* is 11 m"),
        ({"speed_mps": 0.0}, "speed_mps"),
        ({"speed_mps": 100.0}, "speed_mps. is 360 km/h; use 0.5 to 30 km/h"),
        ({"turn_speed_mps": math.nan}, "turn_speed_mps"),
        ({"headland_m": 0.0}, "headland_m"),
        ({"headland_m": math.inf}, "headland_m"),
        ({"radius_m": -4.0}, "radius_m"),
        ({"price_per_hour": -1.0}, "price_per_hour is -1; use 0 to 1,000,000,000"),
        ({"price_per_tractor": math.inf}, "price_per_tractor"),
        ({"deadline_s": 3600}, "needs a start"),
        ({"start_s": 7200, "deadline_s": 7200}, "02:00 is the start itself"),
        ({"start_s": 7200, "deadline_s": 90000}, "deadline_s is 90000; give seconds of the day"),
        ({"start_s": -1}, "start_s is -1; give seconds of the day"),
        ({"seed": -1}, "seed. is -1; use 0 to 9,007,199,254,740,992"),
    ],
)
def test_refusals_name_value_rule_and_fix(options: dict[str, Any], words: str) -> None:
    with pytest.raises(RequestError, match=words) as refusal:
        PlanRequest("f", **options)
    sentence = str(refusal.value)
    assert "\n" not in sentence and sentence.endswith(".") and len(sentence) < 200
    assert "--" not in sentence, "a library knows no options"
    assert refusal.value.parameter in PlanRequest.__dataclass_fields__
    told = refusal.value.render_sentence(get_option_name)
    assert not re.search(r"\w+_(m|mps|s|deg)\b", told), told
    if mark_parameter(refusal.value.parameter) in refusal.value.args[0]:
        assert get_option_name(refusal.value.parameter) in told


def test_turns_may_be_as_quick_as_the_work_unless_asked_otherwise() -> None:
    for speed_kmh, turn_kmh in ((3.0, 3.0), (5.0, 5.0), (8.0, 8.0)):
        assert PlanRequest(speed_mps=speed_kmh / 3.6).effective_turn_speed_mps == pytest.approx(turn_kmh / 3.6)
    assert PlanRequest(speed_mps=1.0, turn_speed_mps=2.0).effective_turn_speed_mps == 2.0


def test_all_strategies_or_those_named_once_each() -> None:
    assert parse_strategies(" all ") == PlanRequest().strategies
    assert parse_strategies("split-field, row-by-row,split-field") == ("split-field", "row-by-row")


def test_nothing_is_suggested_for_a_name_like_no_other() -> None:
    assert suggest_name("zzzz", ("split-field",)) == ""
    assert suggest_name("best", ("fastest", "cheapest", "surest")) == "", "alike in most letters, and another word"
    assert suggest_name("quickest", ("fastest", "cheapest", "surest")) == ""


@pytest.mark.parametrize(
    ("name", "meant"), [("surst", "surest"), ("fast", "fastest"), ("SUREST", "surest"), ("field", "split-field")]
)
def test_slips_beginnings_and_words_of_a_name_are_understood(name: str, meant: str) -> None:
    assert suggest_name(name, ("fastest", "surest", "split-field")) == f" (did you mean {meant!r}?)"


def test_defaults_are_those_of_the_thesis() -> None:
    scenario = PlanRequest("f")
    assert scenario.width_m == 3.0
    assert scenario.speed_mps == scenario.effective_turn_speed_mps == pytest.approx(5 / 3.6)


class TestBlame:
    @pytest.mark.parametrize(
        ("name", "value"),
        [
            ("field", None), ("field", 3), ("local", 1), ("width_m", "3"), ("width_m", None), ("width_m", True),
            ("bearing_deg", "n"), ("tractor", None), ("tractors", 3), ("tractors", "1-3"),
            ("strategies", "split-field"), ("turn", None), ("start_s", 1.5), ("seed", 1.5), ("gnss", "yes"),
            ("gnss_table", 3),
        ],
    )  # fmt: skip
    def test_another_kind_of_value_is_refused_by_name(self, name: str, value: Any) -> None:
        with pytest.raises(RequestError, match=rf"^{name} is .*; give (a|names|whole|True)") as caught:
            PlanRequest(**{name: value})
        assert caught.value.parameter == name

    @pytest.mark.parametrize("name", ["width_m", "headland_m", "radius_m", "price_per_hour", "price_per_tractor"])
    @pytest.mark.parametrize("value", [1e300, math.inf])
    def test_what_is_far_too_large(self, name: str, value: float) -> None:
        with pytest.raises(RequestError, match=r"; use (more than )?0") as caught:
            PlanRequest(**{name: value})
        assert caught.value.parameter == name

    @pytest.mark.parametrize(
        ("ask", "parameter"),
        [
            (lambda: prepare_context(WorkOrder(PlanRequest("nowhere.geojson"))), "field"),
            (lambda: prepare_context(WorkOrder(PlanRequest(), tractor="none")), "tractor"),
            (lambda: prepare_context(WorkOrder(PlanRequest(gnss=True, gnss_table="none.csv"))), "gnss_table"),
            (lambda: prepare_context(WorkOrder(PlanRequest(radius_m=0.1))), "radius_m"),
        ],
    )
    def test_what_a_site_cannot_have(self, ask: Callable[[], object], parameter: str) -> None:
        with pytest.raises(HeadlandError, match=r"none|nowhere|radius") as caught:
            ask()
        assert caught.value.parameter == parameter


@pytest.mark.parametrize("limits", [{"min_speed_mps": 2.0}, {"max_speed_mps": 1.0}])
def test_a_working_speed_outside_what_the_implement_does_is_refused(limits: dict[str, Any]) -> None:
    with pytest.raises(RequestError, match="of the implement") as refusal:
        PlanRequest(speed_mps=1.5, **limits)
    assert refusal.value.parameter == "speed_mps"
    assert PlanRequest(speed_mps=1.5, min_speed_mps=1.5, max_speed_mps=1.5).speed_mps == 1.5
