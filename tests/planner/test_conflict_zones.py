"""How two trajectories interact, counted pose by pose, and what is computed once for several plans."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

from planner.traffic.conflict_zones import (
    MERGE_GAP_S,
    ConflictTable,
    ConflictZones,
    find_conflict_zones,
)
from planner.traffic.precedence import PrecedenceSearch
from planner.traffic.timetable_search import GAP_BEHIND_S
from planner.traffic.trajectories import SoloTrajectory, TrajectoryCache, get_trajectories
from strategies.programmes.waiting_places import POSE_STEP_M
from tests.examples import count_examples
from tests.planner.grid import (
    CHECK,
    Cells,
    all_hold_points,
    crossings,
    plan_on,
    straight,
    traffic,
    trajectory,
)
from vehicle.missions.plan import Leg, Mission, Plan
from vehicle.missions.run import DONE, TIMEOUT, SimulationRun
from vehicle.records import RECORD_COLUMNS
from vehicle.sim.path_conflicts import PosePath

Rows = list[tuple[int, tuple[float, float]]]


def rows(table: ConflictTable, place: int) -> Rows:
    """What a table says of a place."""
    own = slice(table.start[place], table.start[place + 1])
    return [(at, (s[0], s[1])) for at, s in zip(table.at[own].tolist(), table.span_s[own].tolist(), strict=True)]


def stretches_of(one: SoloTrajectory, place: int) -> list[int]:
    """The segments that a place belongs to; two for a hold point between them."""
    return [n for n in range(one.segment_count) if one.holds[n] <= place <= one.holds[n + 1]]


def met(a: SoloTrajectory, b: SoloTrajectory) -> Iterator[tuple[int, int]]:
    """Pairs of places that both cannot take."""
    for i, first, last in CHECK.find_blocked_parts(PosePath(a.poses), PosePath(b.poses)).tolist():
        yield from ((i, j) for j in range(first, last + 1))


def check_pair(table: ConflictZones, i: int, j: int) -> None:
    """Every meeting lies in a span, every span begins and ends at one, and who comes by a hold point is told."""
    a, b = table.trajectories[i], table.trajectories[j]
    lags: dict[tuple[int, int], list[float]] = {}
    passing: dict[tuple[int, int], list[float]] = {}
    for p, q in met(a, b):
        for s in stretches_of(a, p):
            for u in stretches_of(b, q):
                lags.setdefault((s, u), []).append((b.time_s[q] - b.get_begin_s(u)) - (a.time_s[p] - a.get_begin_s(s)))
        if p in a.holds:
            for u in stretches_of(b, q):
                passing.setdefault((a.holds.index(p), u), []).append(float(b.time_s[q]) - b.get_begin_s(u))
    step = float(max(np.diff(a.time_s).max(), np.diff(b.time_s).max()))
    for s in range(a.segment_count):
        for u in range(b.segment_count):
            place, other = int(table.base[i]) + s, int(table.base[j]) + u
            spans = [span for at, span in rows(table.apart, place) if at == other]
            own = lags.get((s, u), [])
            assert all(any(low <= lag <= high for low, high in spans) for lag in own)
            for low, high in spans:
                inside = [lag for lag in own if low <= lag <= high]
                assert min(inside) - low <= step + 1e-9 and high - max(inside) <= step + 1e-9
            assert sorted(span for at, span in rows(table.apart, other) if at == place) == sorted(
                (-high, -low) for low, high in spans
            )
    for hold in range(a.segment_count + 1):
        told = [row for row in rows(table.stands, int(table.base[i]) + hold) if row[0] in range(*table.base[j : j + 2])]
        assert {at - int(table.base[j]) for at, _ in told} == {u for number, u in passing if number == hold}
        for at, (first, last) in told:
            times = passing[hold, at - int(table.base[j])]
            assert first == pytest.approx(min(times)) and max(times) <= last <= max(times) + step + 1e-9


@settings(max_examples=count_examples(60))
@given(traffic())
def test_spans_and_hold_points_are_those_of_the_places_that_meet(drawn: Cells) -> None:
    table = all_hold_points(drawn.trajectories())
    for i in range(len(table.trajectories)):
        for j in range(len(table.trajectories)):
            if i < j:
                check_pair(table, i, j)
            elif i > j:
                told = {(at, place) for place in range(table.base[-1]) for at, _ in rows(table.stands, place)}
                assert told == {(place, at) for place in range(table.base[-1]) for at, _ in rows(table.blockers, place)}


def test_spans_nearer_than_two_seconds_are_one() -> None:
    """One goes back and forth over the place where the other crosses, with a short and a long pause between."""
    over = [(0.0, 0.0, 0.0)] * 3
    for pause, spans in ((1, 1), (20, 2)):
        away = [(200.0 + n, 300.0, 0.0) for n in range(pause)]
        first = trajectory([(300.0, 0.0, 0.0), *over, *away, *over, (300.0, 0.0, 0.0)], [0, 7 + pause], 1.0)
        second = trajectory([(0.0, 300.0, 0.0), (0.0, 0.0, 0.0), (0.0, 300.0, 0.0)], [0, 2], 0.5)
        table = crossings([first, second])
        assert len(rows(table.apart, 0)) == spans
        low, high = rows(table.apart, 0)[0][1]
        assert high - low > 3.0 and MERGE_GAP_S == 2.0


def moved(mission: Mission, seconds: float = 20.0, outcome: str = DONE) -> SimulationRun:
    """A run along x of a mission of one leg."""
    count = round(10 * seconds) + 1
    record = np.zeros((count, 1, len(RECORD_COLUMNS)))
    record[:, 0, 0] = np.linspace(0.0, mission.legs[0].length_m, count)
    return SimulationRun(Plan((mission,)), outcome, 0.1 * np.arange(count), record, np.array([seconds]), (), np.inf)


def along(metres: float, speed_mps: float = 1.0, **more: object) -> Mission:
    return Mission((Leg(np.array([[0.0, 0.0], [metres, 0.0]]), speed_mps, **more),))  # type: ignore[arg-type]


class TestWhatIsKnown:
    def test_the_same_way_is_driven_once_and_another_anew(self) -> None:
        driven: list[Mission] = []
        known = TrajectoryCache()

        def alone(plan: Plan, numbers: Sequence[int]) -> Iterator[SimulationRun]:
            driven.extend(plan.missions[number] for number in numbers)
            return (moved(plan.missions[number]) for number in numbers)

        same = [along(16.0), along(16.0)]
        assert same[0].legs[0].points is not same[1].legs[0].points
        found = get_trajectories(Plan(tuple(same)), alone, known)
        assert found[0] is found[1] and len(driven) == 1
        assert np.diff(found[0].poses["x"])[:-1] == pytest.approx(POSE_STEP_M, abs=0.09)
        for other in (along(16.0, 1.5), along(17.0), along(16.0, gear=-1), along(16.0, implement=True)):
            get_trajectories(Plan((other,)), alone, known)
        assert len(driven) == 5

    def test_who_does_not_get_home_alone_has_no_trajectory(self) -> None:
        mission = along(16.0)
        assert get_trajectories(Plan((mission,)), lambda *_: [moved(mission, outcome=TIMEOUT)]) is None

    def test_meetings_are_looked_up_and_what_is_too_much_is_forgotten(self, monkeypatch: pytest.MonkeyPatch) -> None:
        known = TrajectoryCache()
        trajectories = [straight(-40, 0, 0.0, 80, [0, 10, 80]), straight(0, -42, 1.5, 84, [0, 12, 84])]
        fresh = find_conflict_zones(trajectories, CHECK, [set(), set()])
        for _ in range(2):
            again = find_conflict_zones(trajectories, CHECK, [set(), set()], known)
            assert (again.apart.span_s == fresh.apart.span_s).all() and len(known.meetings) == 1
        known.pose_count = 10**9
        known.clear_if_too_large()
        assert not known.meetings and known.pose_count == 0


def test_thirty_that_cross_one_road_get_home_one_behind_the_other() -> None:
    """Each crosses from its own lane to the road and leaves it at its end: no lane meets another."""
    count = 30
    road = [(400.0 + 12.0 * n, 0.0, 0.0) for n in range(6)]
    trajectories = []
    for one in range(count):
        lane = [(12.0 * one, 12.0 * n - 60.0, 0.5 * np.pi) for n in range(5)]
        trajectories.append(trajectory([*lane, *road, (700.0 + 12.0 * one, 100.0, 0.0)], [0, 3, 11], 4.0))
    table = PrecedenceSearch(plan_on(trajectories), crossings(trajectories)).find_timetable()
    entered = sorted(begins[-1] for begins in table.begins_s)
    gaps = np.diff(entered)
    assert (gaps >= 4.0 + GAP_BEHIND_S - 1e-9).all() and table.duration_s == max(table.free_s)
    late = replace(trajectories[0], time_s=trajectories[0].time_s * 2.0)
    slow = PrecedenceSearch(plan_on([late, *trajectories[1:]]), crossings([late, *trajectories[1:]])).find_timetable()
    assert slow.duration_s > table.duration_s
