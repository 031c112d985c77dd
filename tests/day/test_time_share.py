"""A field that takes longer than its share of computing: it is said, and the others are planned."""

import pickle
from collections.abc import Iterator
from pathlib import Path

import pytest
import shapely

import planner.evaluation.time_share as shares
from fields import write_field
from fields.geometry.field import Field
from planner.cli.common.progress import StageBar
from planner.day.field_times import FieldTime, compute_field_time, compute_field_times
from planner.day.input_file import load_day
from planner.day.planning import plan_day, prepare_day
from planner.evaluation.preparation import prepare_context
from planner.evaluation.time_share import TimeShare, TimeSpentError
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.executors import LocalPool, SerialExecutor, iter_completed
from planner.pipeline.result_cache import ResultCache
from planner.request.plan_request import PlanRequest
from vehicle.model.tractor import Implement, load_tractor

REQUEST = PlanRequest(field="hard", tractors=(1,), strategies=("split-field", "interleaved"))
MINUTE_S = 60.0
DAY = """
start = "08:00"
strategies = ["split-field"]
[[fields]]
file = "hard.geojson"
[[fields]]
file = "easy.geojson"
[[fleets]]
name = "one"
"""


class CountedClock:
    """A clock of the thread by which every question takes a second, so that every machine cuts at the same place."""

    def __init__(self) -> None:
        self.questions = 0

    def thread_time(self) -> float:
        self.questions += 1
        return float(self.questions)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[CountedClock]:
    counted = CountedClock()
    monkeypatch.setattr(shares, "time", counted)
    yield counted


def build_task(width_m: float = 40.0) -> WorkOrder:
    field = Field(f"field of {width_m:g} m", shapely.box(0, 0, width_m, 60))
    return WorkOrder(REQUEST, field, load_tractor("eg105"), Implement())


@pytest.fixture(scope="module")
def free() -> tuple[FieldTime, int]:
    """The plan that no limit gives, and the questions that it takes."""
    with pytest.MonkeyPatch.context() as patch:
        counted = CountedClock()
        patch.setattr(shares, "time", counted)
        return compute_field_time(build_task(), 1e9), counted.questions


def test_half_a_share_is_kept_for_what_follows(clock: CountedClock) -> None:
    share = TimeShare(4.0)
    with share.save_half():
        share.check()  # 1 s and 2 s of the first 2 s
        share.check()
        with pytest.raises(TimeSpentError):
            share.check()
    share.check()
    assert share.is_cut
    with pytest.raises(TimeSpentError):
        share.check()


class TestCut:
    @pytest.mark.slow
    def test_enough_time_gives_the_plan_that_no_limit_gives(
        self, clock: CountedClock, free: tuple[FieldTime, int]
    ) -> None:
        """It lasts: the cache may keep it, whatever the machine."""
        plan, limited = free[0], compute_field_time(build_task(), 1e6)
        assert not plan.cut_note and plan.is_lasting
        assert (limited.strategy, limited.time_s, limited.cut_note) == (plan.strategy, plan.time_s, "")

    @pytest.mark.slow
    def test_the_best_plan_found_by_then_is_taken(self, clock: CountedClock, free: tuple[FieldTime, int]) -> None:
        """Every share between none and enough: from some share on there is a plan, cut short, and said to be."""
        needed_s = free[1]
        cuts = [compute_field_time(build_task(), share * needed_s / MINUTE_S) for share in (0.02, 0.5, 0.99)]
        assert all(cut.cut_note and not cut.is_lasting for cut in cuts)
        assert cuts[0].graph is None and "min of computing" in cuts[0].reason
        assert cuts[-1].graph is not None and cuts[-1].worked_pct is not None

    def test_what_was_cut_is_not_kept_in_the_cache(self, clock: CountedClock, tmp_path: Path) -> None:
        cache = ResultCache(tmp_path)
        ((cut,),), _ = compute_field_times([[build_task()]], cache, SerialExecutor(), field_minutes=0.02)
        assert cut is not None and cut.cut_note and not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_rest_of_the_day_is_planned_and_the_hard_field_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The hard field takes its whole share: its clock runs by hours."""
    for name, width_m in (("hard", 45), ("easy", 40)):
        write_field(
            Field(name, shapely.box(0, 0, width_m, 60), crs="EPSG:32633", origin_m=(5e5, 5e6)),
            tmp_path / f"{name}.geojson",
        )
    (tmp_path / "day.toml").write_text(DAY)
    prepared = prepare_day(*load_day(tmp_path / "day.toml"))
    names: list[list[str]] = []
    hard_share = TimeShare(-1.0)

    def share_of(seconds: float) -> TimeShare:
        return hard_share if names[-1] == ["hard"] else TimeShare(seconds)

    monkeypatch.setattr("planner.day.field_times.TimeShare", share_of)
    day = plan_day(prepared, samples=50, report_work=names.append)
    assert names == [["hard"], ["easy"]]
    assert [job.field for job in day.jobs] == ["easy"]
    (question,) = day.questions
    assert question == ("hard, one: no plan was found in 10 min of computing. Give it more (--field-minutes).")
    assert question in day.advice
    assert "no plan was found in 10 min of computing" in day.unworked_fields[0].reason


def test_a_context_sent_to_another_process_has_no_limit() -> None:
    context = prepare_context(WorkOrder(REQUEST, build_task().field), time_share=TimeShare(1e6))
    sent = pickle.loads(pickle.dumps(context))
    assert sent.time_share.is_spent() is False


def test_progress_names_what_is_at_work() -> None:
    bar = StageBar("Simulating fields")
    bar.report("Simulating fields", 2, 9)
    assert bar.describe() == "Simulating fields: 2 of 9"
    bar.show_work(["north", "north"])
    assert bar.describe() == "Simulating fields: 2 of 9 (north)"
    bar.show_work(["north", "south", "east"])
    assert bar.describe() == "Simulating fields: 2 of 9 (north, south, ...)"


@pytest.mark.slow
def test_a_pool_tells_which_tasks_are_at_work() -> None:
    """One process and the caller: two at a time, and never one that is only handed over."""
    told: list[list[int]] = []
    with LocalPool(1) as pool:
        results = dict(iter_completed(pool, abs, [(-k,) for k in range(6)], told.append))
    assert results == {k: k for k in range(6)}
    assert all(len(each) <= 2 for each in told) and {index for each in told for index in each} <= set(results)
