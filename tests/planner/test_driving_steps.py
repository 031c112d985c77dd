"""What each tractor does, in order: every second of a run is in one step, and each says what it is for."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely

from planner.evaluation.candidates.evaluate import Candidate, run_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.site import build_site
from planner.pipeline.outputs.driving_steps import _classify_turn, list_steps
from strategies.lines.line_wishes import name_line
from strategies.moves.drives import build_path_legs
from strategies.path_planning.turns import list_turns
from vehicle.missions.plan import Leg, LegGate, LegTask, Mission, Plan
from vehicle.missions.run import SimulationRun, find_longest_reversing
from vehicle.model.tractor import Implement, load_tractor
from vehicle.sim.world import simulate


@pytest.fixture(scope="module")
def worked(place: Any) -> tuple[PlanningContext, SimulationRun]:
    site = place(shapely.box(0, 0, 60, 100), no_headland=False)
    return site, run_candidate(site, Candidate("split-field", 2)).run


def test_steps_are_the_whole_run_without_gaps(worked: tuple[PlanningContext, SimulationRun]) -> None:
    _, run = worked
    for tractor, steps in enumerate(list_steps(run, 3.0)):
        assert steps[0].from_s == 0.0
        for before, after in pairwise(steps):
            assert before.from_s + before.seconds == pytest.approx(after.from_s, abs=1e-9)
        assert steps[-1].from_s + steps[-1].seconds == pytest.approx(run.finish_s[tractor], abs=0.11)
        driven = float(np.hypot(*np.diff(run.get_poses(tractor)[:, :2], axis=0).T).sum())
        assert sum(step.length_m for step in steps) == pytest.approx(driven, abs=0.5)


def test_every_track_and_side_is_a_step_once(worked: tuple[PlanningContext, SimulationRun]) -> None:
    site, run = worked
    steps = [step for own in list_steps(run, 3.0) for step in own]
    tracks = [step.number for step in steps if step.kind == "track" and not step.continues]
    assert sorted(tracks) == [track.line + 1 for track in site.layout.swaths]
    sides = {(step.number, step.part) for step in steps if step.kind == "round"}
    assert sides == {
        (number, str(side)) for number in range(1, site.layout.headland_passes + 1) for side in (1, 2, 3, 4)
    }
    assert all(step.part == "" for step in steps if step.kind == "track")


def test_sides_are_called_the_same_whichever_way_they_are_driven(worked: tuple[PlanningContext, SimulationRun]) -> None:
    _, run = worked
    ways: dict[str, set[int]] = {}
    for step in (step for own in list_steps(run, 3.0) for step in own if step.kind == "round"):
        assert step.bearing_deg is not None
        ways.setdefault(step.part, set()).add(round(step.bearing_deg) % 180)
    assert all(len(bearings) == 1 for bearings in ways.values()), "a side is one line of the rectangle"
    assert sorted(bearing for (bearing,) in ways.values()) == [0, 0, 90, 90]


def test_tracks_have_their_direction_and_turns_count_the_tracks_they_lead_over(
    worked: tuple[PlanningContext, SimulationRun],
) -> None:
    _, run = worked
    for steps in list_steps(run, 3.0):
        for before, turn, after in zip(steps, steps[1:], steps[2:], strict=False):
            if turn.kind == "turn" and before.kind == after.kind == "track":
                assert turn.over_swaths == abs(before.number - after.number) and turn.number == after.number
                assert abs(before.bearing_deg - after.bearing_deg) % 360 == pytest.approx(180, abs=1e-6)
            if turn.kind == "corner":
                assert before.number == turn.number == after.number and before.part != after.part == turn.part


def straight(x0: float, x1: float, y: float, number: int, gates: tuple[LegGate, ...] = ()) -> Leg:
    points = np.array([[x0, y], [x1, y]])
    return Leg(points, 1.5, implement=True, task=LegTask("track", number), gates=gates)


def test_a_wait_names_who_is_waited_for() -> None:
    # Tractor 2 may begin its second track when tractor 1 has driven 90 m: 60 s at 1.5 m/s, less what it starts with.
    first = Mission((straight(0, 100, 0, 0),))
    second = Mission((straight(0, 30, 20, 4), straight(30, 60, 20, 6, (LegGate(0, 0, 90.0),))))
    run = simulate(Plan((first, second)), load_tractor("eg105"), Implement(width_m=3.0))
    one, two = list_steps(run, 3.0)
    assert [step.kind for step in one] == ["track"]
    assert [(step.kind, step.number, step.for_tractors) for step in two] == [
        ("track", 5, ()), ("wait", None, (1,)), ("track", 7, ())
    ]  # fmt: skip
    assert two[1].seconds == pytest.approx(40.0, abs=5.0) and two[1].length_m < 0.5
    assert (two[0].bearing_deg, two[0].x_m) == (pytest.approx(90.0), pytest.approx(15.0, abs=3.0))


def test_a_stop_in_a_track_parts_it() -> None:
    first = Mission((straight(0, 100, 0, 0),))
    second = Mission((straight(0, 30, 20, 4), straight(30, 60, 20, 4, (LegGate(0, 0, 90.0),))))
    run = simulate(Plan((first, second)), load_tractor("eg105"), Implement(width_m=3.0))
    assert [(step.kind, step.continues) for step in list_steps(run, 3.0)[1]] == [
        ("track", False), ("wait", False), ("track", True)
    ]  # fmt: skip


def test_a_way_says_how_far_it_is_reversed_and_over_what() -> None:
    # 40 m back along its own track, which is finished; the other tractor's track beside it is not touched.
    points = np.array([(60.0, 0.0), (20.0, 0.0)])
    back = Leg(points, 1.0, gear=-1, task=LegTask("way", 7))
    plan = Plan((Mission((straight(0, 60, 0, 4), back)), Mission((straight(0, 60, 20, 9),))))
    run = simulate(plan, load_tractor("eg105"), Implement(width_m=3.0))
    steps, _ = list_steps(run, 3.0)
    assert [step.kind for step in steps] == ["track", "way"]
    assert (steps[0].reversing_m, steps[0].over_finished) == (0.0, ())
    assert steps[1].reversing_m == pytest.approx(40.0, abs=3.0)
    assert find_longest_reversing(run) == (steps[1].reversing_m, 1, False), "the remark has the metres of this list"
    assert steps[1].over_finished == ("5",) and steps[1].over_finished_m == pytest.approx(40.0, abs=4.0)
    assert not steps[1].over_standing


def test_a_way_says_over_which_crop_it_leads_that_still_stands() -> None:
    # Back over the 30 m that were worked, and 30 m of the track that comes next.
    back = Leg(np.array([(60.0, 0.0), (0.0, 0.0)]), 1.0, gear=-1, task=LegTask("way", 8))
    plan = Plan((Mission((straight(30, 60, 0, 4), back, straight(0, 30, 0, 8))),))
    run = simulate(plan, load_tractor("eg105"), Implement(width_m=3.0))
    (steps,) = list_steps(run, 3.0, operation="harvest")
    assert [step.kind for step in steps] == ["track", "way", "track"]
    assert (steps[1].over_finished, steps[1].over_standing) == (("5",), ("9",))
    assert steps[1].over_standing_m == pytest.approx(30.0, abs=3.0) == steps[1].over_finished_m
    assert not list_steps(run, 3.0)[0][1].over_standing, "where nothing stands"


@pytest.mark.parametrize("kind", ["u", "omega", "switch-back"])
def test_turns_are_called_as_they_were_planned(place: Any, kind: str) -> None:
    site = place(shapely.box(0, 0, 60, 100), no_headland=True)
    radius_m, width_m = site.driving_rules.radius_m, site.layout.width_m
    across_m = {"u": math.ceil(2.0 * radius_m / width_m), "omega": 1, "switch-back": 1}[kind] * width_m
    path = next(turn for turn in list_turns(across_m, radius_m) if turn.kind == kind)
    assert _classify_turn(build_path_legs(build_site(site), path, LegTask("turn", 1))) == kind


def test_a_way_that_hardly_bends_has_no_shape() -> None:
    quarter = [(10 * math.sin(t), 10 - 10 * math.cos(t)) for t in np.linspace(0, math.pi / 2, 20)]
    assert _classify_turn([Leg(np.array(quarter), 1.0)]) == ""


def test_names_of_tracks() -> None:
    assert [name_line(LegTask("track", 1, piece, True)) for piece in (0, 1)] == ["2a", "2b"]
    assert [name_line(LegTask("track", 7, piece, True)) for piece in (25, 26, 27)] == ["8z", "8aa", "8ab"]
    assert [name_line(LegTask(kind, 1)) for kind in ("track", "round")] == ["2", "R1"]
    assert name_line(LegTask("round", 1, 3, True)) == "R1.4"


def test_a_turn_into_another_cell_counts_no_tracks(place: Any) -> None:
    site = place(shapely.Polygon([(0, 0), (130, 0), (130, 50), (50, 50), (50, 130), (0, 130)]), no_headland=False)
    assert len(site.layout.cells) > 1
    cells = {swath.line + 1: swath.cell_number for swath in site.layout.swaths}
    (steps,) = list_steps(run_candidate(site, Candidate("split-field", 1)).run, 3.0)
    last, across = None, 0
    for step in steps:
        if step.kind in ("turn", "way") and last is not None and not step.is_headland_pass:
            if cells[last] == cells[step.number or 0]:
                assert step.kind == "way" or step.over_swaths == abs(last - (step.number or 0))
            else:
                across += 1
                assert step.over_swaths is None
        last = step.number if step.kind == "track" else None
    assert across
