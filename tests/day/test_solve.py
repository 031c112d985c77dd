"""The best order of fields: days worked out by hand, all orders tried, search beside proof."""

from typing import Any

import pytest

from planner.day.optimization.lagrangian_bound import compute_lower_bound
from planner.day.optimization.problem import HASTE_COST_PER_S, DayProblem, RainOnsets, make_empty_routes, repair_routes
from planner.day.optimization.solver import choose_routes, compute_least_costs, search_routes, solve_day
from tests.day.days import DAY, at_random, by_hand, every_day, least_cost

LINE = [[0, 600, 900], [600, 0, 300], [900, 300, 0]]  # two fields on one road; the last place is the depot


def share_seeds(count: int) -> list[Any]:
    """So many seeds, the second half of them in the matrix."""
    later = [pytest.param(seed, marks=pytest.mark.matrix) for seed in range(count // 2, count)]
    return [*range(count // 2), *later]


def test_two_fields_and_one_fleet() -> None:
    """Depot - near field 300 s - far field 600 s further: 300 + 1000 + 600 + 2000 + 900 s, near before far."""
    problem = by_hand([[2000, 1000]], LINE, put_off=[100.0, 100.0], per_move_s=0.01)
    day = solve_day(problem)
    assert day.routes == ((1, 0),) and day.gap_pct == 0.0
    assert problem.schedule_starts(0, (1, 0)) == [300, 1900]
    assert day.cost == pytest.approx(0.01 * (300 + 600 + 900) + HASTE_COST_PER_S * (1300 + 3900))


def test_a_window_forces_the_order() -> None:
    problem = by_hand([[2000, 1000]], LINE, put_off=[100.0, 100.0], windows=[[(0, 3000)], [(0, DAY)]], per_move_s=0.01)
    assert solve_day(problem).routes == ((0, 1),)
    assert problem.schedule_starts(0, (0, 1)) == [900, 3500]
    later = by_hand([[2000, 1000]], LINE, put_off=[100.0, 100.0], windows=[[(0, 2899), (9000, 11000)], [(0, DAY)]])
    assert later.schedule_starts(0, (0,)) == [9000], "the first window is a second too short"
    assert later.schedule_starts(0, (1, 0)) == [300, 9000]


def test_a_field_that_is_too_far_is_left() -> None:
    """The way there and back costs 0.05 x (600 + 900 - 300) = 60 more than the near field alone."""
    for worth, done in ((59.0, ((1,),)), (61.0, ((1, 0),))):
        day = solve_day(by_hand([[2000, 1000]], LINE, put_off=[worth, 100.0], per_move_s=0.05))
        assert day.routes == done and day.gap_pct == 0.0


def test_two_fleets_share_the_fields_when_the_day_is_short() -> None:
    """Each has 300 + 1000 + 300 s for its field; both fields by one fleet take 300 + 1000 + 100 + 1000 + 300 s."""
    move = [[0, 100, 300], [100, 0, 300], [300, 300, 0]]
    short = by_hand([[1000, 1000]] * 2, move, put_off=[50.0, 50.0], per_move_s=0.01, home_by_s=2699)
    assert sorted(map(len, solve_day(short).routes)) == [1, 1]
    long = by_hand([[1000, 1000]] * 2, move, put_off=[50.0, 50.0], per_move_s=0.01, home_by_s=2700)
    assert sorted(map(len, solve_day(long).routes)) == [0, 2], "one way less, though it is done later"


def test_rain_takes_what_is_not_done() -> None:
    """Rain for certain after 1500 s: of 1000 s of work begun at 1300 s 0.8 are lost, of 2000 s begun at 900 s 0.7."""
    rain = RainOnsets(((1500, 1.0),))
    assert rain.estimate_undone_share(1300, 1000) == pytest.approx(0.8)
    assert RainOnsets(((1500, 0.5), (1600, 0.25))).estimate_undone_share(900, 2000) == pytest.approx(
        0.5 * 0.7 + 0.25 * 0.65
    )
    assert rain.estimate_undone_share(400, 1000) == 0.0 and rain.estimate_undone_share(1500, 1000) == 1.0
    costs = by_hand([[2000, 1000]], LINE, put_off=[90.0, 90.0], stake=[80.0, 80.0], rain=rain)
    assert costs.compute_route_cost(0, (1, 0)) == pytest.approx(80.0 + HASTE_COST_PER_S * (1300 + 3900))
    assert solve_day(costs).routes == ((1, 0),)


@pytest.mark.parametrize("seed", share_seeds(12))
def test_the_proven_day_is_the_best_of_all(seed: int) -> None:
    problem = at_random(seed, fields=3 + seed % 3, fleets=1 + seed % 2)
    best, day = least_cost(problem), solve_day(problem)
    assert day.cost == pytest.approx(best, abs=1e-4) and day.gap_pct == 0.0
    assert day.cost == problem.compute_day_cost(day.routes)
    assert sum(compute_least_costs(problem)) <= best + 1e-9


@pytest.mark.parametrize("seed", share_seeds(6))
def test_search_reaches_the_proven_day(seed: int) -> None:
    problem = at_random(100 + seed, fields=7, fleets=2)
    day = solve_day(problem)
    assert day.gap_pct == 0.0
    assert problem.compute_day_cost(search_routes(problem, effort=60_000)) == pytest.approx(day.cost, abs=1e-4)


def test_search_is_never_worse_than_plain_insertion() -> None:
    problem = at_random(7, fields=14, fleets=3)
    start = repair_routes(problem, make_empty_routes(problem), range(problem.field_count), use_regret=False)
    assert cost_of(problem, search_routes(problem, effort=2_000)) <= cost_of(problem, start)


def test_routes_find_what_the_search_has_missed() -> None:
    """From a day on which nobody goes anywhere all routes are worth having."""
    problem = at_random(3, fields=5, fleets=2)
    nothing = cost_of(problem, make_empty_routes(problem))
    choice = choose_routes(problem, nothing, [0.0] * problem.field_count)
    assert choice is not None and choice.routes is not None
    assert cost_of(problem, choice.routes) == pytest.approx(least_cost(problem), abs=1e-6)
    assert choice.lower_bound == pytest.approx(least_cost(problem), abs=1e-4)


@pytest.mark.slow
def test_too_many_routes_leave_a_gap_that_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = at_random(5, fields=9, fleets=2)
    best = solve_day(problem)
    assert best == solve_day(problem) and best.gap_pct == 0.0
    monkeypatch.setattr("planner.day.optimization.solver.MAX_LABELS", 20)
    rough = solve_day(problem)
    assert rough.cost >= best.cost - 1e-6
    assert sum(compute_least_costs(problem)) - 1e-6 <= rough.cost * (1.0 - rough.gap_pct / 100.0) <= best.cost + 1e-4
    assert rough.gap_pct < 2.0, "prices on fields are near"


@pytest.mark.slow
@pytest.mark.parametrize("seed", share_seeds(8))
def test_prices_on_fields_never_tell_more_than_the_best_day(seed: int) -> None:
    problem = at_random(300 + seed, fields=3 + seed % 3, fleets=1 + seed % 2)
    best, least = least_cost(problem), compute_least_costs(problem)
    found = compute_lower_bound(problem, best, least)
    assert sum(least) <= found <= best + 1e-6
    assert found == compute_lower_bound(problem, best, least)
    assert compute_lower_bound(problem, 1.5 * best, least) <= best + 1e-6, "with a day that is worse as well"


def test_prices_on_fields_of_jobs_shorter_than_their_grain() -> None:
    """Three fields of a minute each on one spot: one fleet does all, whatever times are rounded to."""
    move = [[0, 0, 0, 100]] * 3 + [[100, 100, 100, 0]]
    problem = by_hand([[60, 60, 60]], move, put_off=[10.0] * 3, per_move_s=0.01)
    best = least_cost(problem)
    assert compute_lower_bound(problem, best, compute_least_costs(problem)) == pytest.approx(best, rel=1e-3)


def test_no_field_twice_and_none_outside_its_window() -> None:
    problem = at_random(11, fields=12, fleets=3)
    routes = solve_day(problem).routes
    done = [field for route in routes for field in route]
    assert len(done) == len(set(done))
    for fleet, route in enumerate(routes):
        starts = problem.schedule_starts(fleet, route)
        assert starts is not None
        for field, start in zip(route, starts, strict=True):
            work = problem.work_s[fleet][field]
            assert work is not None
            assert any(opens <= start and start + work <= closes for opens, closes in problem.windows[field])


def test_every_day_counts_what_it_should() -> None:
    """Two fields, one fleet: none, either, both in two orders."""
    assert len(list(every_day(by_hand([[1, 1]], LINE, put_off=[1.0, 1.0])))) == 5


def cost_of(problem: DayProblem, routes: tuple[tuple[int, ...], ...]) -> float:
    cost = problem.compute_day_cost(routes)
    assert cost is not None
    return cost
