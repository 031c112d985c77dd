"""What the benchmark of machines sets into fields, asks for, measures and counts."""

import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from fields.documents.reader import read_field
from fields.geometry.field import Field
from tests.benchmarks.machine_cases import REFERENCE, Row, run_case
from tests.benchmarks.machine_faults import (
    find_sharpest_bend,
    find_worst,
    measure_driven_km,
    measure_longest_reverse_m,
    measure_overhang_m,
)
from tests.benchmarks.machine_fields import (
    APART_M,
    EDGES,
    OBSTACLE_COUNTS,
    Condition,
    build_field,
    measure_fit,
    save_field,
)
from tests.benchmarks.machines import choose_conditions, choose_machines, compare_rows, group_reasons, summarise_group
from tests.benchmarks.odd_shapes import build_odd_shapes
from tests.examples import count_examples
from vehicle.missions.plan import SWATH, TURN, Leg, LegTask, Mission, Plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.model.tractor import Implement, load_tractor

PARCEL = Field("parcel", shapely.box(0.0, 0.0, 120.0, 90.0))


def build_row(**values: Any) -> Row:
    return replace(Row("p:3m@eg105:0:open", "p", 1.0, "3m@eg105", "0:open", True, False, 80.0, 100.0), **values)


@settings(max_examples=count_examples(20))
@given(st.integers(0, 10_000), st.sampled_from(OBSTACLE_COUNTS), st.sampled_from(EDGES))
def test_obstacles_are_drawn_by_seed_and_lie_apart(seed: int, count: int, edge: str) -> None:
    """The same seed gives the same field; obstacles lie within the outline and apart; a fence all round has a gate."""
    field = build_field(PARCEL, Condition(count, edge), seed)
    again = build_field(PARCEL, Condition(count, edge), seed)
    shapes = [one.shape for one in field.obstacles]
    assert field.obstacles == again.obstacles and field.entrance == again.entrance and len(shapes) == count
    assert all(PARCEL.boundary.contains(shape) for shape in shapes)
    apart = [a.distance(b) for number, a in enumerate(shapes) for b in shapes[:number]]
    assert min(apart, default=math.inf) >= APART_M
    assert (field.entrance is not None) == (edge in ("entrance", "fence"))
    assert sum(fence.length for fence in field.fences) == pytest.approx(
        {"fence": 420.0, "fence-part": 252.0}.get(edge, 0.0)
    )


def test_a_saved_field_is_read_as_it_was(tmp_path: Path) -> None:
    """Obstacles, fences and entrance of the file are those of the case."""
    field = build_field(PARCEL, Condition(20, "fence"), 3)
    save_field(field, tmp_path / "case.geojson")
    found = read_field(tmp_path / "case.geojson", local=True)
    assert found.area_m2 == pytest.approx(field.area_m2, rel=1e-6)
    assert [one.kind for one in found.obstacles] == [one.kind for one in field.obstacles]
    assert found.entrance is not None and len(found.fences) == 1


@pytest.mark.parametrize(("width_m", "radius_m", "fits"), [(10.0, 5.0, True), (10.1, 5.0, False), (4.0, 13.5, False)])
def test_a_field_fits_three_widths_and_a_full_turn(width_m: float, radius_m: float, fits: bool) -> None:
    """30 m across hold three widths of 10 m, and a circle of 13 m radius with 4 m of width."""
    fit = measure_fit(Field("strip", shapely.box(0.0, 0.0, 200.0, 30.0)), width_m, radius_m)
    assert fit.across_m == pytest.approx(30.0, abs=1.0) and fit.reachable_pct == pytest.approx(100.0)
    assert replace(fit, across_m=30.0).fits is fits


def test_a_bar_reaches_what_no_neck_cuts_off() -> None:
    """Of 5000 and 3000 m2 joined by a lane of 3 m a bar of 4 m reaches the larger, one of 2 m all."""
    lane = shapely.box(100.0, 20.0, 140.0, 23.0)
    parts = shapely.union_all([shapely.box(0.0, 0.0, 100.0, 50.0), lane, shapely.box(140.0, 0.0, 200.0, 50.0)])
    wide, narrow = (measure_fit(Field("parts", parts), width_m, 4.0) for width_m in (4.0, 2.0))
    assert wide.reachable_pct == pytest.approx(100.0 * 5000.0 / 8120.0, abs=0.1)
    assert narrow.reachable_pct == pytest.approx(100.0, abs=0.1)


def test_odd_shapes_are_fields() -> None:
    """Sixty trees every 6 m, 400 points, two halves of a ditch, and the area of a ring."""
    shapes = build_odd_shapes()
    assert len(shapes["orchard"].obstacles) == 60
    assert len(shapes["points-400"].boundary.exterior.coords) == 401
    assert shapes["thin-ring"].area_m2 == pytest.approx(math.pi * (70.0**2 - 60.0**2), rel=0.02)
    halves = shapely.get_parts(shapes["ditch-across"].boundary.difference(shapes["ditch-across"].obstacles[0].shape))
    assert len(halves) == 2


def test_four_parcels_see_every_number_and_edge_and_sixteen_every_pair() -> None:
    drawn = [choose_conditions(number, "one")[0] for number in range(16)]
    assert {one.obstacles for one in drawn[4:8]} == set(OBSTACLE_COUNTS) and {one.edge for one in drawn[4:8]} == set(
        EDGES
    )
    assert set(drawn) == set(choose_conditions(0, "all")) and len(set(drawn)) == 16


def test_machines_are_chosen_by_key_and_tractor() -> None:
    assert [one.name for one in choose_machines("4m,6m@eg105", "usual")] == ["4m@eg105", "6m@eg105"]
    assert [one.tractor for one in choose_machines("6m", "all")] == ["eg105", "r55", "r70"]
    with pytest.raises(SystemExit, match="7m"):
        choose_machines("7m", "usual")


def test_the_sharpest_bend_of_an_arc_is_its_radius() -> None:
    """A quarter of a circle of 8 m between straights; 60 m before the bend the path is straight."""
    turn = np.linspace(0.0, 0.5 * math.pi, 200)
    arc = 8.0 * np.column_stack([np.sin(turn), 1.0 - np.cos(turn)])
    line = np.concatenate([[[-100.0, 0.0]], arc, [[8.0, 60.0]]])
    angle, radius = find_sharpest_bend(line, np.array([8.0, 10.0]))
    assert math.degrees(angle) == pytest.approx(90.0, abs=3.0) and radius == pytest.approx(8.0, rel=0.1)
    assert find_sharpest_bend(line, np.array([-70.0, 1.0]))[1] == math.inf


def build_run() -> tuple[SimulationRun, Any]:
    """A tractor driven straight east along y = 2 m, then in reverse over two legs, in a field whose edge is y = 0."""
    points = [
        np.array([[float(a), 2.0], [float(b), 2.0]]) for a, b in ((0, 50), (50, 45), (45, 42), (42, 60), (60, 54))
    ]
    tasks = [LegTask(SWATH, 1), *[LegTask(TURN, 2)] * 4]
    legs = tuple(
        Leg(line, 2.0, gear, task=task) for line, gear, task in zip(points, (1, -1, -1, 1, -1), tasks, strict=True)
    )
    x = np.concatenate([np.linspace(line[0, 0], line[1, 0], 10) for line in points])
    record = np.zeros((50, 1, 7))
    record[:, 0, 0], record[:, 0, 1], record[:, 0, 4], record[:, 0, 5] = x, 2.0, 2.0, np.repeat(np.arange(5), 10)
    run = SimulationRun(Plan((Mission(legs),)), DONE, np.linspace(0.0, 4.9, 50), record, np.array([5.0]), (), math.inf)
    field = Field("field", shapely.box(-50.0, 0.0, 150.0, 50.0))
    context = SimpleNamespace(
        tractor=load_tractor("eg105"), implement=Implement(width_m=6.0), layout=SimpleNamespace(field=field)
    )
    return run, context


def test_the_worst_row_of_a_run_is_described() -> None:
    """The depth is greatest where x is, at the end of the fourth leg; a measure of 0 finds nothing."""
    run, context = build_run()
    worst = find_worst(run, context, "east of 30", lambda poses: float(np.max(poses[:, 0] - 30.0, initial=0.0)))
    assert worst is not None and worst.depth_m == pytest.approx(30.0) and (worst.leg, worst.kind) == (3, TURN)
    assert worst.speed_kmh == pytest.approx(7.2) and "leg 3 (turn, forward, lifted)" in str(worst)
    assert find_worst(run, context, "nothing", lambda poses: 0.0) is None


def test_reverse_driving_adds_up_over_legs_and_frames_hang_over_the_edge() -> None:
    """5 and 3 m in one go are longer than 6 m; of a frame of 5.4 m driven 2 m from the edge 0.7 m are beyond it."""
    run, context = build_run()
    assert measure_longest_reverse_m(run) == pytest.approx(8.0)
    assert measure_driven_km(run) == pytest.approx((50.0 + 5.0 + 3.0 + 18.0 + 6.0) / 1000.0)
    assert measure_overhang_m(run, context) == pytest.approx(0.7, abs=1e-6)


def test_a_field_without_a_plan_counts_as_not_worked() -> None:
    """Of three that fit two have a plan; the one that does not fit counts nowhere. CPU is a ratio of sums."""
    good = {"feasible": True, "driven_km": 2.0, "reference_cpu_s_per_km": 1.0}
    rows = [
        build_row(worked_pct=99.0, cpu_s=1.0, formation_feasible=True, **good),
        build_row(worked_pct=97.0, cpu_s=3.0, reachable_pct=97.0, formation_feasible=False, **good),
        build_row(reason="No path of 8 m leads anywhere"),
        build_row(fits=False, reason="No track fits 3 ha"),
    ]
    assert rows[1].worked_of_reachable_pct == 100.0 and rows[0].cpu_ratio == 0.5
    cells = summarise_group("3m", rows).split()
    assert cells[:6] == ["3m", "4", "3", "66.7%", "97.00", "0.00"]
    assert cells[-3:] == ["50%", "1.00", "0.0"]


def test_reasons_are_counted_without_their_numbers() -> None:
    rows = [build_row(case=f"c{number}", reason=f"leaves by {number} m") for number in (1, 2)]
    crash = build_row(
        case="c3", crash="KeyError: 3 (a.py:7)", formation_feasible=False, formation_reason="meet after 9 s"
    )
    assert list(group_reasons([*rows, crash])) == [
        "   2 leaves by m: c1, c2", "   1 KeyError:: c3", "   1 two: meet after s: c3",
    ]  # fmt: skip


def test_two_runs_are_compared_case_by_case(tmp_path: Path) -> None:
    """A lost plan, a won one, another share and a lost formation are named; what is the same is not."""
    old = [build_row(case=f"c{number}", feasible=number != 1, reason="why", worked_pct=99.0) for number in range(4)]
    old[3].formation_feasible = True
    (tmp_path / "old.json").write_text("".join(json.dumps(row.to_values()) + "\n" for row in old))
    new = [
        build_row(case="c0", reason="now not"), build_row(case="c1", feasible=True, worked_pct=99.0),
        build_row(case="c2", feasible=True, worked_pct=98.0),
        build_row(case="c3", feasible=True, worked_pct=99.0, formation_feasible=False, formation_reason="they meet"),
        build_row(case="new"),
    ]  # fmt: skip
    told = list(compare_rows(new, tmp_path / "old.json"))
    assert [line.split(":")[0] for line in told] == ["LOST c0", "won  c1", "     c2", "LOST two c3"]


@pytest.mark.slow
def test_a_case_is_planned_and_a_refusal_is_recorded() -> None:
    """3 m at 5 km/h works a plain parcel; on one of 20 x 20 m nothing of 36 m is planned, and the row says why."""
    row = run_case(PARCEL, Condition(), REFERENCE, 1, with_formation=False, reference=None)
    assert row.feasible and row.worked_pct is not None and row.worked_pct > 98.0 and row.crash is None
    assert row.driven_km is not None and row.driven_km > 1.08 / 0.3
    tiny = Field("tiny", shapely.box(0.0, 0.0, 20.0, 20.0))
    refused = run_case(tiny, Condition(), choose_machines("36m", "usual")[0], 1, with_formation=True, reference=None)
    assert not refused.feasible and not refused.fits and refused.reason and refused.crash is None
