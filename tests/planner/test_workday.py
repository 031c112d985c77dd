"""The clock round field work: breaks, shifts, the road; by hand and by properties."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from fields import Field
from planner.errors import RequestError
from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.farm.inventory import FarmFile
from planner.farm.settings import FarmPrices, FarmTimes, Yard
from planner.farm.workday import BREAK, FOLD, NIGHT, ROAD, UNFOLD, Workday, build_workday, estimate_road_m
from planner.pipeline.farm_inputs import complete_request_by_farm
from planner.pipeline.ranking import describe_next_day_times, describe_workday
from planner.request.option_texts import format_later_clock
from planner.request.plan_request import PlanRequest
from planner.risk.costs import CostTerms, compute_hourly_rates, compute_travel_cost

pytestmark = pytest.mark.usefixtures("first_layout")

HOUR = 3600
ONE = Workday(7 * HOUR, breaks_s=((12 * HOUR, 12 * HOUR + 1800),), shift_s=(7 * HOUR, 19 * HOUR))
FIELD = Field("far", shapely.box(0, 0, 40, 90), crs="EPSG:32632", origin_m=(550_000.0, 6_300_000.0))


class TestClock:
    @pytest.mark.parametrize(("work_h", "clock_h"), [
        (0.0, 0.0), (4.0, 4.0), (5.0, 5.0), (5.5, 6.0), (11.5, 12.0), (12.0, 24.5), (23.0, 36.0),
    ])  # fmt: skip
    def test_by_hand(self, work_h: float, clock_h: float) -> None:
        """From 7 on: five hours until noon, half an hour of break, 11.5 hours of work a shift, then the next day."""
        assert ONE.compute_clock_s(work_h * HOUR) == pytest.approx(clock_h * HOUR)

    def test_what_follows_begins_after_the_break(self) -> None:
        assert ONE.compute_clock_s(5.0 * HOUR, begins=True) == pytest.approx(5.5 * HOUR)
        assert ONE.compute_clock_s(11.5 * HOUR, begins=True) == pytest.approx(24 * HOUR)

    def test_a_shift_over_midnight(self) -> None:
        """22:00 to 06:00 from 23:00 on: seven hours, then sixteen of rest."""
        night = Workday(23 * HOUR, shift_s=(22 * HOUR, 30 * HOUR))
        assert [night.compute_clock_s(hours * HOUR) / HOUR for hours in (1, 7, 8, 15, 16)] == [1, 7, 24, 31, 48]

    def test_a_break_over_midnight(self) -> None:
        late = Workday(22 * HOUR, breaks_s=((int(23.5 * HOUR), int(24.5 * HOUR)),))
        assert late.compute_clock_s(2.0 * HOUR) == pytest.approx(3.0 * HOUR)

    def test_before_the_shift_everybody_waits_for_it(self) -> None:
        early = replace(ONE, start_s=5 * HOUR)
        assert early.compute_clock_s(1.0 * HOUR) == pytest.approx(3.0 * HOUR)
        assert early.list_pauses(HOUR)[0].kind == NIGHT

    def test_without_a_start_there_is_no_clock(self) -> None:
        assert replace(ONE, start_s=None).compute_clock_s(1e6) == 1e6

    def test_part_of_a_night_a_break_is_none(self) -> None:
        both = replace(ONE, breaks_s=((18 * HOUR, 21 * HOUR),))
        assert [(one.kind, one.from_s / HOUR, one.to_s / HOUR) for one in both.list_pauses(20 * HOUR)] == [
            (BREAK, 11.0, 14.0), (NIGHT, 14.0, 20.0),
        ]  # fmt: skip
        assert both.compute_clock_s(11.5 * HOUR) == pytest.approx(24.5 * HOUR)

    def test_breaks_that_leave_no_time_are_refused(self) -> None:
        with pytest.raises(RequestError, match="take its whole shift"):
            Workday(9 * HOUR, breaks_s=((8 * HOUR, 12 * HOUR),), shift_s=(9 * HOUR, 11 * HOUR))

    @given(st.floats(0.0, 40.0 * HOUR), st.integers(0, 23), st.integers(1, 23), st.integers(0, 22), st.integers(1, 3))
    def test_there_and_back(self, work: float, start: int, shift: int, pause: int, long: int) -> None:
        """Work done at a clock is what fits before it, however breaks and shift lie; the clock only grows."""
        span = (pause * HOUR, (pause + long) * HOUR)
        try:
            day = Workday(start * HOUR, breaks_s=(span,), shift_s=(6 * HOUR, (6 + shift) * HOUR))
        except RequestError:
            return
        assert float(day.compute_work_s(np.array(day.compute_clock_s(work)))) == pytest.approx(work, abs=1e-5)
        assert day.compute_clock_s(work + 60.0) >= day.compute_clock_s(work) + 60.0 - 1e-6
        inside = [
            one
            for one in day.list_pauses(100.0 * HOUR)
            if one.from_s < day.compute_clock_s(work) - 1e-5 < one.to_s - 1e-3
        ]
        assert not inside

    def test_nothing_is_done_in_a_pause(self) -> None:
        noon = np.array([5.0, 5.2, 5.5, 5.6, np.inf]) * HOUR
        assert (ONE.compute_work_s(noon) / HOUR).tolist() == pytest.approx([5.0, 5.0, 5.0, 5.1, math.inf])


class TestRoad:
    def test_is_the_straight_line_times_a_factor(self) -> None:
        """A hundredth of a degree of latitude is 1113.9 m at 57 degrees (WGS84)."""
        centre = FIELD.boundary.centroid
        ((lon, lat),) = FIELD.to_wgs84([(centre.x, centre.y)]).tolist()
        yard, times = Yard(lon=lon, lat=lat - 0.01), FarmTimes(road_speed_kmh=36.0, road_factor=1.5)
        road_m = estimate_road_m(FIELD, yard, times)
        assert road_m == pytest.approx(1.5 * 1113.9, rel=1e-3)
        day = build_workday(FIELD, None, times, yard)
        assert day.road_m == road_m and day.sum_duties_s(ROAD) == pytest.approx(2.0 * road_m / 10.0)

    def test_ends_at_the_entrance(self) -> None:
        gate = replace(FIELD, entrance=(0.0, 0.0))
        ((lon, lat),) = gate.to_wgs84([(0.0, 0.0)]).tolist()
        assert estimate_road_m(gate, Yard(lon=lon, lat=lat), FarmTimes()) == pytest.approx(0.0, abs=1e-3)

    def test_has_no_length_without_yard_or_earth(self) -> None:
        assert estimate_road_m(FIELD, Yard(), FarmTimes()) is None
        assert estimate_road_m(replace(FIELD, crs=None), Yard(lon=9.0, lat=56.0), FarmTimes()) is None

    def test_from_a_yard_beyond_reach_is_refused(self) -> None:
        with pytest.raises(RequestError, match="km from field 'far' in a straight line"):
            estimate_road_m(FIELD, Yard(lon=-9.0, lat=56.0), FarmTimes())


class TestDay:
    TIMES = FarmTimes(unfold_s=60.0, fold_s=90.0, road_speed_kmh=36.0, road_factor=1.0, breaks=("12:00-12:30",))

    def day(self, start_s: int | None = 8 * HOUR) -> Workday:
        return build_workday(FIELD, start_s, self.TIMES, Yard(lon=9.83, lat=56.83))

    def test_has_the_road_twice_and_both_hands(self) -> None:
        day = self.day()
        road_s = pytest.approx(estimate_road_m(FIELD, Yard(lon=9.83, lat=56.83), self.TIMES) / 10.0)
        assert [(one.kind, one.seconds) for one in day.duties_before] == [(ROAD, road_s), (UNFOLD, 60.0)]
        assert [(one.kind, one.seconds) for one in day.duties_after] == [(FOLD, 90.0), (ROAD, road_s)]
        assert day.before_field_s + day.after_field_s == pytest.approx(day.sum_duties_s(ROAD) + 150.0)

    def test_a_plan_counts_it(self) -> None:
        """Two tractors: transport of both; ready, done and home by the clock; a deadline is one of field work."""
        yard = Yard(lon=9.83, lat=56.83)
        plain = PlanRequest(field="far", no_headland=True, start_s=8 * HOUR, transport_width_m=2.5)
        terms = CostTerms(FarmPrices(per_hour=36.0, supervision_share=0.0))
        free = simulate_candidate(
            prepare_context(WorkOrder(plain, FIELD, cost_terms=terms)), Candidate("split-field", 2)
        ).result
        assert free.transport_s is None
        day = self.day()
        until = 8 * HOUR + math.ceil(day.before_field_s + free.time_s)
        for before, meets in ((until + 1, True), (until - 2, False)):
            asked_for = replace(plain, deadline_s=before, samples=0)
            site = prepare_context(WorkOrder(asked_for, FIELD, cost_terms=terms, times=self.TIMES, yard=yard))
            found = simulate_candidate(site, Candidate("split-field", 2)).result
            assert found.meets_deadline is meets
        assert found.time_s == free.time_s
        assert found.transport_s == pytest.approx(2 * (day.before_field_s + day.after_field_s))
        assert found.ready_s == pytest.approx(day.before_field_s)
        assert found.done_s == pytest.approx(day.before_field_s + free.time_s)
        assert found.home_s == pytest.approx(day.before_field_s + free.time_s + day.after_field_s)
        assert found.cost - free.cost == pytest.approx(0.01 * found.transport_s)
        words = describe_workday(day, site.request, found)
        assert len(words) == 1 and "out at 08:00" in words[0]

    def test_a_rigid_implement_is_not_folded(self) -> None:
        order = WorkOrder(PlanRequest(field="far", transport_width_m=3.0), FIELD, times=self.TIMES, yard=Yard())
        assert prepare_context(order).workday == build_workday(
            FIELD, None, FarmTimes(unfold_s=0.0, fold_s=0.0, breaks=self.TIMES.breaks), Yard()
        )

    def test_draws_count_it(self) -> None:
        """What is certain is in time by the clock or never: before the road, the break and the night are over."""
        scenario = PlanRequest(field="far", no_headland=True, start_s=8 * HOUR, samples=50)
        free = simulate_candidate(prepare_context(WorkOrder(scenario, FIELD)), Candidate("split-field", 1)).result
        late = 8 * HOUR + round(self.day().before_field_s + 0.5 * free.time_s)
        for before, chance in ((late, 0.0), (7 * HOUR, 1.0)):
            site = prepare_context(
                WorkOrder(replace(scenario, deadline_s=before), FIELD, times=self.TIMES, yard=Yard(lon=9.83, lat=56.83))
            )
            assert simulate_candidate(site, Candidate("split-field", 1)).result.finish_probability == chance

    def test_the_shift_gives_the_start(self) -> None:
        farm = FarmFile(times=FarmTimes(shift_start="06:30"))
        assert complete_request_by_farm(PlanRequest(), farm).request.start_s == int(6.5 * HOUR)
        assert complete_request_by_farm(PlanRequest(start_s=9 * HOUR), farm).request.start_s == 9 * HOUR


class TestMoney:
    def test_who_drives_itself_pays_for_the_road_by_the_hour(self) -> None:
        terms = CostTerms(FarmPrices(), road_km=10.0, road_s=1800.0, handling_s=360.0)
        rate, prices = compute_hourly_rates(terms.prices), terms.prices
        people = 0.6 * prices.supervision_share * prices.supervision_per_hour
        machine = 0.5 * (rate.rates_without_fuel + rate.fuel_on_road) + 0.1 * (
            rate.rates_without_fuel + 0.1 * rate.fuel_full
        )
        assert compute_travel_cost(terms) == pytest.approx(people + machine)

    def test_who_is_brought_pays_for_the_lorry(self) -> None:
        prices = FarmPrices(per_hour=30.0, supervision_share=0.0, transport_per_tractor=5.0, transport_per_km=0.5)
        terms = CostTerms(prices, road_km=10.0, road_s=1800.0, handling_s=360.0)
        assert compute_travel_cost(terms) == pytest.approx(5.0 + 5.0 + 0.1 * 30.0)

    def test_without_a_road_it_is_what_it_was(self) -> None:
        assert compute_travel_cost(CostTerms(FarmPrices(transport_per_tractor=8.0))) == 8.0


class TestWords:
    @pytest.mark.parametrize(("start", "after", "words"), [
        (13 * HOUR, 4 * HOUR, "17:00"), (23 * HOUR, 1.67 * HOUR, "00:40 next day"),
        (8 * HOUR, 47.5 * HOUR, "07:30, 2 days later"),
    ])  # fmt: skip
    def test_clocks_past_midnight(self, start: int, after: float, words: str) -> None:
        assert format_later_clock(start, after) == words

    def test_a_time_before_the_start_is_said_to_be_of_the_next_day(self) -> None:
        asked_for = PlanRequest(start_s=13 * HOUR, deadline_s=12 * HOUR, rain="11:30=20,17:00=50")
        assert describe_next_day_times(asked_for) == (
            "The deadline at 12:00 is taken as the next day's: the start is at 13:00.",
            "Rain at 11:30 is taken as the next day's: the start is at 13:00.",
        )
        assert describe_next_day_times(PlanRequest(start_s=13 * HOUR, deadline_s=17 * HOUR, rain="0.2/h")) == ()

    def test_rain_of_another_day_is_not_said_to_be_of_the_next(self, tmp_path: Path) -> None:
        ensemble = tmp_path / "rain.csv"
        ensemble.write_text("hours\n30\n8\n8.001\n")
        assert describe_next_day_times(PlanRequest(start_s=22 * HOUR, rain=str(ensemble))) == (
            "Rain at 06:00 is taken as the next day's: the start is at 22:00.",
        )

    def test_the_end_of_a_shift_is_told(self) -> None:
        from reports.common.plan_results import PlanResult

        plan = PlanResult("x", 1, "u", True, ready_s=0.0, done_s=25.0 * HOUR, home_s=25.5 * HOUR)
        words = describe_workday(ONE, PlanRequest(start_s=7 * HOUR), plan)
        assert words[-1] == "The shift ends at 19:00 before the work is done; it continues at 07:00 next day."
        assert words[-2] == "This includes a break of 30 min."
