"""What others worked is done by their logs: their width, and their positions with their error."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from planner.errors import RequestError
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.going_on import OTHERS_ERROR_M, go_on
from planner.request.plan_request import PlanRequest
from tests.drawn_fields import feature, ring, write_features
from tests.works.conftest import TRACK_M, TRACKS, WIDTH_M, lonlat

pytestmark = pytest.mark.usefixtures("first_layout")

DONE_M2 = TRACKS * TRACK_M * WIDTH_M


def write_field(path: Path, west_m: float) -> str:
    """A field of 60 by 120 m, the tracks of the logs in it where `west_m` is -6."""
    east_m, south_m, north_m = west_m + 60.0, -10.0, 110.0
    corners = np.array([[west_m, south_m], [east_m, south_m], [east_m, north_m], [west_m, north_m]])
    return str(write_features(path, feature(ring(*lonlat(corners).tolist()))))


def leave(field: str, done: Path) -> PlanningContext:
    order = WorkOrder(PlanRequest(field=field, width_m=WIDTH_M), done=(str(done),))
    return go_on(prepare_context(order), order)


@pytest.mark.slow
def test_time_logs_of_isoxml_and_imported_runs_are_done_alike(
    headland: Callable[..., Any], taskdata: Path, tmp_path: Path
) -> None:
    field, runs = write_field(tmp_path / "field.geojson", -6.0), tmp_path / "runs"
    assert headland("logs", "import", taskdata, "-o", runs)[0] == 0
    contexts = [leave(field, source) for source in (taskdata, runs)]
    for context in contexts:
        done, going_on = context.layout.field.done, context.going_on
        assert going_on is not None and going_on.error_m == OTHERS_ERROR_M and not going_on.stands
        assert done is not None and done.area == pytest.approx(DONE_M2, rel=0.03)
    first, second = (context.layout.field.done for context in contexts)
    assert first is not None and second is not None and first.symmetric_difference(second).area < 0.01 * DONE_M2
    one = ("--tractors", 1, "--strategies", "split-field", "--processes", 1)
    status, out, _ = headland("plan", field, "--width", WIDTH_M, "--done", taskdata, *one)
    assert status == 0 and "> recommended" in out


@pytest.mark.slow
def test_logs_of_another_field_are_refused(taskdata: Path, tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="give work of this field, or the field of this work"):
        leave(write_field(tmp_path / "field.geojson", 400.0), taskdata)
