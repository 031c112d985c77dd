"""What is known of moves is cached from run to run: the next plan is the same, and drives none of its moves again."""

import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import shapely

from fields.geometry.field import Field
from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import get_site_moves
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.move_cache import MoveCache, count_entries, describe_entries, load_entries
from planner.pipeline.planning import PlanningResult, plan_order
from planner.pipeline.ranking import list_candidates
from planner.pipeline.result_cache import NO_CACHE, ResultCache
from planner.pipeline.worker_tasks import evaluate_task, pack_context
from planner.request.plan_request import PlanRequest
from reports.plan.figures import format_ranking_json
from strategies.moves.drives import MoveDrives
from strategies.programmes.site_moves import SiteMoves
from vehicle.model.tractor import Implement

pytestmark = pytest.mark.usefixtures("first_layout")

FIELD = Field("bay", shapely.Polygon([(0, 0), (120, 0), (120, 70), (70, 70), (60, 40), (50, 70), (0, 70)]))
REQUEST = PlanRequest(field="bay", width_m=6.0, tractors=(1, 2), strategies=("split-field",))
FOLDING = WorkOrder(
    replace(REQUEST, width_m=9.0), replace(FIELD, entrance=(30.0, 0.0)), implement=Implement(transport_width_m=3.0)
)


def plan(cache: MoveCache | None, request: PlanRequest = REQUEST) -> PlanningResult:
    return plan_order(WorkOrder(request, FIELD), executor=SerialExecutor(), cache=cache.results if cache else NO_CACHE)


@pytest.fixture(scope="module", autouse=True)
def forget_outcomes(first_layout: None) -> Iterator[None]:
    """Nothing but moves is known of the plan before."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("planner.pipeline.planning.recall_outcomes", lambda *known: known[-1](range(len(known[2]))))
        yield


@pytest.fixture
def drives(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many moves were given to every drive."""
    counts, drive = list[int](), MoveDrives.prove

    def count(self: MoveDrives, passages: Any) -> Any:
        counts.append(len(passages))
        return drive(self, passages)

    monkeypatch.setattr(MoveDrives, "prove", count)
    return counts


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("moves")


@pytest.fixture(scope="module")
def first(folder: Path, forget_outcomes: None) -> PlanningResult:
    """A plan of which the folder holds the moves from then on."""
    return plan(MoveCache(ResultCache(folder)))


@pytest.fixture(scope="module")
def told(first: PlanningResult) -> str:
    return format_ranking_json(first.ranking)


@pytest.fixture
def cache(folder: Path, first: PlanningResult, tmp_path: Path) -> MoveCache:
    """A cache that holds the moves of the plan."""
    return MoveCache(ResultCache(shutil.copytree(folder, tmp_path / "moves")))


def test_the_next_plan_is_the_same_and_drives_no_move(tmp_path: Path, drives: list[int]) -> None:
    def answer(results: ResultCache) -> str:
        return format_ranking_json(plan_order(FOLDING, executor=SerialExecutor(), cache=results).ranking)

    plain = answer(NO_CACHE)
    assert sum(drives) > 20
    first, files = answer(ResultCache(tmp_path)), sorted(tmp_path.iterdir())
    drives.clear()
    second = answer(ResultCache(tmp_path))
    assert first == second == plain
    assert sum(drives) == 0
    assert sorted(tmp_path.iterdir()) == files


def test_another_process_is_told_all_and_reads_and_stores_nothing(cache: MoveCache, drives: list[int]) -> None:
    packed, pairs = pack_context(plan(cache).context), [one for one in list_candidates(REQUEST) if one.tractors == 2]
    for path in cache.results.folder.iterdir():
        path.unlink()
    drives.clear()
    with ThreadPoolExecutor(1) as other:  # a thread unpacks a context of its own
        assert other.submit(evaluate_task, packed, pairs).result()[0][1].result.feasible
    assert sum(drives) == 0 and not [*cache.results.folder.iterdir()]


def test_more_tractors_find_what_one_has_found(cache: MoveCache, drives: list[int]) -> None:
    more = replace(REQUEST, tractors=(3,), price_per_hour=50.0)
    plain = format_ranking_json(plan(None, more).ranking)
    alone, _ = sum(drives), drives.clear()
    assert format_ranking_json(plan(cache, more).ranking) == plain
    assert sum(drives) < 0.7 * alone


@pytest.mark.parametrize("damage", [lambda text: "{", lambda text: text.replace("1", "2", 40)])
def test_a_damaged_file_and_a_number_that_somebody_changed_are_not_believed(
    cache: MoveCache, told: str, damage: Callable[[str], str]
) -> None:
    for path in cache.results.folder.iterdir():
        path.write_text(damage(path.read_text()))
    assert format_ranking_json(plan(cache).ranking) == told


def test_a_file_that_others_refer_to_may_be_missing(cache: MoveCache, told: str) -> None:
    more = format_ranking_json(plan(cache, replace(REQUEST, tractors=(3,))).ranking)
    oldest = min(cache.results.folder.iterdir(), key=lambda path: path.stat().st_mtime_ns)
    oldest.unlink()
    assert format_ranking_json(plan(cache).ranking) == told
    assert format_ranking_json(plan(cache, replace(REQUEST, tractors=(3,))).ranking) == more


def test_what_is_known_is_told_whole_or_by_what_is_new(first: PlanningResult) -> None:
    known = get_site_moves(first.context)
    entries = describe_entries(known, {})
    assert set(entries) >= {"estimates", "options", "driven"}
    assert describe_entries(known, count_entries(known)) == {}
    again = SiteMoves(known.site, known.lines)
    load_entries(again, [entries, entries])
    assert describe_entries(again, {}) == entries
    for pair, options in known.options.items():
        for move, other in zip(options, again.options[pair], strict=True):
            assert (known.driven.get(move) is None) is (again.driven.get(other) is None)


CHANGES: list[Callable[[PlanRequest], PlanRequest]] = [
    lambda request: replace(request, width_m=5.5),
    lambda request: replace(request, speed_mps=1.5),
    lambda request: replace(request, radius_m=6.0),
    lambda request: replace(request, overhang_m=0.2),
    lambda request: replace(request, open_edges=True),
    lambda request: replace(request, operation="sow"),
    lambda request: replace(request, corners="round"),
]


@pytest.mark.parametrize("change", CHANGES)
def test_what_depends_on_another_machine_or_rule_is_not_loaded(cache: MoveCache, change: Any) -> None:
    other = prepare_context(WorkOrder(change(REQUEST), FIELD), move_cache=cache)
    assert not get_site_moves(other).driven


def test_another_implement_or_tractor_is_not_taken_for_the_one_before(cache: MoveCache) -> None:
    same = get_site_moves(prepare_context(WorkOrder(REQUEST, FIELD), move_cache=cache))
    longer = WorkOrder(REQUEST, FIELD, implement=Implement(hitch_m=3.0, length_m=2.5))
    heavier = WorkOrder(REQUEST, FIELD).resolve_tractor().model_copy(update={"mass_kg": 4500.0})
    assert same.driven
    for order in (longer, WorkOrder(REQUEST, FIELD, tractor=heavier)):
        assert not get_site_moves(prepare_context(order, move_cache=cache)).driven
