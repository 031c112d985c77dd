"""Maps as JSON: the same plans as on the page, and places that are true to the drive at their times."""

import json
from dataclasses import replace

import numpy as np

from reports.common.plan_records import PlanDrive, Relief
from reports.common.plan_results import PlanRanking
from reports.plan.map_data import PATH_TOLERANCE_M, format_maps_json


def test_places_at_their_times_are_those_of_the_drive(ranking: PlanRanking, listed_drive: PlanDrive) -> None:
    plan = json.loads(format_maps_json(ranking, listed_drive))["plans"][0]
    for lane, xy in zip(plan["lanes"], listed_drive.xy, strict=True):
        times = np.arange(len(xy)) * listed_drive.step_s
        told = np.column_stack([np.interp(times, lane["time_s"], np.array(lane["points_m"])[:, k]) for k in (0, 1)])
        assert np.hypot(*(told - xy).T).max() <= PATH_TOLERANCE_M + 0.02
        assert len(lane["status"]) == len(lane["time_s"]) - 1
    assert [len(lane["steps"]) for lane in plan["lanes"]] == [len(steps) for steps in listed_drive.steps]
    assert plan["end_s"] == max(listed_drive.finish_s) and len(plan["swaths"]) == len(listed_drive.swaths)


def test_the_best_plan_is_first_and_others_follow_by_their_names(ranking: PlanRanking, drive: PlanDrive) -> None:
    best = ranking.best
    others = {("row-by-row", 5): replace(drive, title="other"), (best.strategy, best.tractors): drive}
    plans = json.loads(format_maps_json(ranking, drive, others))["plans"]
    told = [(plan["strategy"], plan["tractors"]) for plan in plans]
    assert told == [(best.strategy, best.tractors), ("row-by-row", 5)]
    assert json.loads(format_maps_json(ranking, None))["plans"] == []


def test_contours_are_those_of_the_relief(listed_drive: PlanDrive, ranking: PlanRanking) -> None:
    assert "relief" not in json.loads(format_maps_json(ranking, listed_drive))
    bent = np.array([[0.0, 0.0], [5.0, 0.1], [10.0, 0.0], [10.0, 8.0]])  # 0.1 m beside its chord: straight on a map
    relief = Relief(np.full((2, 2), 0.7), (0.0, 0.0, 10.0, 10.0), ((12.5, bent),), 0.5)
    found = json.loads(format_maps_json(ranking, replace(listed_drive, relief=relief)))["relief"]
    assert found == {"interval_m": 0.5, "contours_m": [[[0.0, 0.0], [10.0, 0.0], [10.0, 8.0]]]}
