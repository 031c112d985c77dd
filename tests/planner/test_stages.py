"""What `plan` reports of its stages, and that reporting changes nothing."""

import pytest
import shapely

from fields.geometry.field import Field
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.planning import LAYING_OUT, SIMULATING, STAGES_S, plan
from planner.request.plan_request import PlanRequest
from reports.plan.figures import format_ranking_json


@pytest.mark.slow
def test_stages_come_in_order_and_are_counted() -> None:
    request = PlanRequest(field="drawn", tractors=(1, 2), strategies=("split-field",))
    field = Field("drawn", shapely.box(0.0, 0.0, 60.0, 45.0))
    reports: list[tuple[str, int, int]] = []

    def report(words: str, done: int, total: int) -> None:
        reports.append((words, done, total))

    told = plan(request, field=field, executor=SerialExecutor(), report_stage=report)
    silent = plan(request, field=field, executor=SerialExecutor())
    assert format_ranking_json(told.ranking) == format_ranking_json(silent.ranking)
    stages = [words for words, _, _ in reports]
    assert list(dict.fromkeys(stages)) == [LAYING_OUT, SIMULATING] == list(STAGES_S)
    assert stages == sorted(stages, key=list(STAGES_S).index)
    layouts = [(done, total) for words, done, total in reports if words == LAYING_OUT]
    assert layouts[0] == (0, 0) and len(layouts) > 2, "before layouts are known none are counted"
    assert layouts[1:] == [(number, len(layouts) - 1) for number in range(len(layouts) - 1)]
    assert [(done, total) for words, done, total in reports if words == SIMULATING] == [(0, 2), (1, 2), (2, 2)]
