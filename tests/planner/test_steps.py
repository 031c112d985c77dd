"""What each tractor does, in order: every second of a run is in one step, and each says what it is for."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely

from planner.candidates.evaluate import Candidate, run_candidate
from planner.site import Site
from planner.steps import _shape, steps_of, track_names
from strategies.job import Pass
from strategies.legs import way_legs
from strategies.ways.connect import Connector
from vehicle.missions import Gate, Leg, Mission, Plan, Task
from vehicle.run import Run
from vehicle.tractor import Implement, load_tractor
from vehicle.world import simulate


@pytest.fixture(scope="module")
def worked(place: Any) -> tuple[Site, Run]:
    site = place(shapely.box(0, 0, 60, 100), tracks_only=False)
    return site, run_candidate(site, Candidate("split-field", 2)).run


def test_steps_are_the_whole_run_without_gaps(worked: tuple[Site, Run]) -> None:
    _, run = worked
    for tractor, steps in enumerate(steps_of(run, 3.0)):
        assert steps[0].from_s == 0.0
        for before, after in pairwise(steps):
            assert before.from_s + before.seconds == pytest.approx(after.from_s, abs=1e-9)
        assert steps[-1].from_s + steps[-1].seconds == pytest.approx(run.finish_s[tractor], abs=0.11)
        driven = float(np.hypot(*np.diff(run.poses(tractor)[:, :2], axis=0).T).sum())
        assert sum(step.length_m for step in steps) == pytest.approx(driven, abs=0.5)


def test_every_track_and_side_is_a_step_once(worked: tuple[Site, Run]) -> None:
    site, run = worked
    steps = [step for own in steps_of(run, 3.0) for step in own]
    tracks = [step.number for step in steps if step.kind == "track" and not step.again]
    assert sorted(tracks) == [track.line + 1 for track in site.layout.tracks]
    sides = {(step.number, step.part) for step in steps if step.kind == "round"}
    assert sides == {(number, str(side)) for number in range(1, site.layout.rounds + 1) for side in (1, 2, 3, 4)}
    assert all(step.part == "" for step in steps if step.kind == "track")


def test_sides_are_called_the_same_whichever_way_they_are_driven(worked: tuple[Site, Run]) -> None:
    _, run = worked
    ways: dict[str, set[int]] = {}
    for step in (step for own in steps_of(run, 3.0) for step in own if step.kind == "round"):
        assert step.bearing_deg is not None
        ways.setdefault(step.part, set()).add(round(step.bearing_deg) % 180)
    assert all(len(bearings) == 1 for bearings in ways.values()), "a side is one line of the rectangle"
    assert sorted(bearing for (bearing,) in ways.values()) == [0, 0, 90, 90]


def test_tracks_have_their_direction_and_turns_count_the_tracks_they_lead_over(worked: tuple[Site, Run]) -> None:
    _, run = worked
    for steps in steps_of(run, 3.0):
        for before, turn, after in zip(steps, steps[1:], steps[2:], strict=False):
            if turn.kind == "turn" and before.kind == after.kind == "track":
                assert before.number is not None and after.number is not None
                assert turn.over == abs(before.number - after.number) and turn.number == after.number
                assert before.bearing_deg is not None and after.bearing_deg is not None
                assert abs(before.bearing_deg - after.bearing_deg) % 360 == pytest.approx(180, abs=1e-6)
            if turn.kind == "corner":
                assert before.number == turn.number == after.number and before.part != after.part == turn.part


def straight(x0: float, x1: float, y: float, number: int, gates: tuple[Gate, ...] = ()) -> Leg:
    points = np.array([[x0, y], [x1, y]])
    return Leg(points, 1.5, implement=True, task=Task("track", number), gates=gates)


def test_a_wait_names_who_is_waited_for() -> None:
    # Tractor 2 may begin its second track when tractor 1 has driven 90 m: 60 s at 1.5 m/s, less what it starts with.
    first = Mission((straight(0, 100, 0, 0),))
    second = Mission((straight(0, 30, 20, 4), straight(30, 60, 20, 6, (Gate(0, 0, 90.0),))))
    run = simulate(Plan((first, second)), load_tractor("eg105"), Implement(width_m=3.0))
    one, two = steps_of(run, 3.0)
    assert [step.kind for step in one] == ["track"]
    assert [(step.kind, step.number, step.for_tractors) for step in two] == [
        ("track", 5, ()), ("wait", None, (1,)), ("track", 7, ())
    ]  # fmt: skip
    assert two[1].seconds == pytest.approx(40.0, abs=5.0) and two[1].length_m < 0.5
    assert (two[0].bearing_deg, two[0].x_m) == (pytest.approx(90.0), pytest.approx(15.0, abs=3.0))


def test_a_stop_in_a_track_parts_it() -> None:
    first = Mission((straight(0, 100, 0, 0),))
    second = Mission((straight(0, 30, 20, 4), straight(30, 60, 20, 4, (Gate(0, 0, 90.0),))))
    run = simulate(Plan((first, second)), load_tractor("eg105"), Implement(width_m=3.0))
    assert [(step.kind, step.again) for step in steps_of(run, 3.0)[1]] == [
        ("track", False), ("wait", False), ("track", True)
    ]  # fmt: skip


@pytest.mark.parametrize("kind", ["u", "omega", "switch-back"])
def test_turns_are_called_as_they_were_planned(place: Any, kind: str) -> None:
    site = place(shapely.box(0, 0, 60, 100), tracks_only=True)
    job = site.job(1)
    connector = Connector(site.free, site.manner.radius_m, site.costs, (kind,))
    by_line = {track.line: track for track in site.layout.tracks}
    over = {"u": 4, "omega": 1, "switch-back": 1}[kind]
    a, b = Pass(by_line[6], 1), Pass(by_line[6 + over], -1)
    path = connector.direct(job.exit(a), job.entry(b))
    assert path is not None and path.kind == kind
    assert _shape(way_legs(job, path, b.track)) == kind


def test_a_way_that_hardly_bends_has_no_shape() -> None:
    quarter = [(10 * math.sin(t), 10 - 10 * math.cos(t)) for t in np.linspace(0, math.pi / 2, 20)]
    assert _shape([Leg(np.array(quarter), 1.0)]) == ""


def test_names_of_tracks() -> None:
    assert track_names([(0, 0), (1, 0), (1, 1), (2, 0)]) == ("1", "2a", "2b", "3")
    assert track_names((7, piece) for piece in range(28))[-3:] == ("8z", "8aa", "8ab")


def test_a_turn_into_another_cell_counts_no_tracks(place: Any) -> None:
    site = place(shapely.Polygon([(0, 0), (130, 0), (130, 50), (50, 50), (50, 130), (0, 130)]), tracks_only=False)
    assert len(site.layout.cells) > 1
    cells = {track.line + 1: track.cell for track in site.layout.tracks}
    (steps,) = steps_of(run_candidate(site, Candidate("split-field", 1)).run, 3.0)
    last, across = None, 0
    for step in steps:
        if step.kind in ("turn", "way") and last is not None and not step.to_round:
            if cells[last] == cells[step.number or 0]:
                assert step.kind == "way" or step.over == abs(last - (step.number or 0))
            else:
                across += 1
                assert step.over is None
        last = step.number if step.kind == "track" else None
    assert across
