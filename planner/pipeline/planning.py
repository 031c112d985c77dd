"""`plan`: every candidate of a request simulated on any executor and ranked, with the run of the best plan."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import shapely

from fields.geometry.field_parts import list_field_parts
from fields.geometry.overlays import clip_area, subtract_area
from planner.errors import HeadlandError, RequestError
from planner.evaluation.candidates.best_drive import prunes_candidates
from planner.evaluation.candidates.evaluate import Candidate, Outcome, drive_plan
from planner.evaluation.context import DoneWork, PlanningContext
from planner.evaluation.machine_outlines import measure_passage_m
from planner.evaluation.preparation import prepare_context
from planner.evaluation.time_share import NO_LIMIT, TimeShare
from planner.evaluation.work_order import DoneSource, FieldChoice, WorkOrder
from planner.farm.random_inputs import UncertaintySettings
from planner.farm.settings import FarmTimes, Yard
from planner.pipeline.executors import create_executor
from planner.pipeline.going_on import (
    AllDoneError,
    continue_order,
    go_on,
    keep_continuing,
    list_numbers,
    list_sources,
)
from planner.pipeline.move_cache import MoveCache
from planner.pipeline.outcome_cache import Outcomes, collect_outcomes, recall_outcomes
from planner.pipeline.outputs.pictures import build_refused_picture, build_run_picture
from planner.pipeline.outputs.saved_plans import write_saved_plan
from planner.pipeline.ranking import check_margin, list_candidates, locate_piece, rank_plans
from planner.pipeline.result_cache import NO_CACHE, ResultCache
from planner.pipeline.worker_tasks import Progress, group_candidates, iter_outcomes, pack_context
from planner.request.parameter_names import WISHES
from planner.request.plan_request import PlanRequest
from planner.risk.assessment import check_best_plan, describe_check
from planner.risk.costs import CostTerms
from reports.common.language import mark_text
from reports.common.plan_records import PlanDrive
from reports.common.plan_results import FieldPartPlan, PlanRanking, PlanResult
from reports.common.rendering import ResultView, ShownResult
from reports.plan.figures import format_ranking_csv
from reports.plan.map_figure import draw_plan_map, render_png
from reports.plan.notebook import build_ranking_view
from reports.plan.ranking_page import render_plan_page
from strategies.names import STRATEGY_NAMES
from strategies.rules.supply import Supply
from vehicle.missions.plan import Plan
from vehicle.missions.run import SimulationRun
from vehicle.model.tractor import Implement, Tractor

if TYPE_CHECKING:
    from geopandas import GeoDataFrame

StageReport = Callable[[str, int, int], None]
LAYING_OUT, SIMULATING = mark_text("Laying out the field"), mark_text("Simulating plans")
STAGES_S = {LAYING_OUT: 4.0, SIMULATING: 6.0}
"""The stages of `plan`, with about the seconds of each for a field of some hectares."""
_UNASKED_OF_PARTS: dict[str, Any] = {
    one.name: one.default
    for one in fields(PlanRequest)
    if one.name in ("deadline_s", "rain", "objective", "budget", "samples", "cell_bearings", *WISHES)
}
"""Parameters of a request that do not hold for a further part: its cells and tracks have numbers of their own."""


@dataclass(frozen=True, eq=False, repr=False)
class PlanningResult(ShownResult):
    """The answer to a request; a notebook shows it as text, map and table.

    `run` is the run of `ranking.best`, None if no plan is feasible. `pictures`, by (strategy, tractors), are of the
    best plan, drawn when asked for, or with `with_pictures` of every plan driven to its end (`driven_pictures`).
    `plans` are the legs and gates of every feasible plan that was simulated, by the same key.

    `to_pandas()` has a row per plan, as the CSV; `to_geodataframe()` the lines of the best plan; `plot()` draws its
    map; `save("best.json")` writes the plan as `headland plan --save` does, and endings .html, .png and .csv write
    page, map and table.
    """

    context: PlanningContext
    ranking: PlanRanking
    run: SimulationRun | None
    driven_pictures: Mapping[tuple[str, int], PlanDrive] | None = None
    plans: Mapping[tuple[str, int], Plan] = field(default_factory=dict)

    @cached_property
    def pictures(self) -> Mapping[tuple[str, int], PlanDrive]:
        """Pictures of drives, drawn when they are asked for."""
        best = self.ranking.best
        if self.driven_pictures is not None or best is None or self.run is None:
            return self.driven_pictures or {}
        return {(best.strategy, best.tractors): build_run_picture(self.context, self.run, best)}

    def get_view(self) -> ResultView:
        """The ranking with the map of the best plan."""
        files: dict[str, Callable[[], str | bytes]] = {
            ".json": self._write_plan,
            ".html": self._render_page,
            ".png": lambda: render_png(draw_plan_map(self._find_picture(), self.ranking.field_name)),
            ".csv": lambda: format_ranking_csv(self.ranking),
        }
        return build_ranking_view(self.ranking, self._find_picture, files)

    def to_geodataframe(self) -> GeoDataFrame:
        """Swaths, headland passes and other driving of the best plan, what it misses, and the field, as geometries.

        Columns and units: planner.pipeline.outputs.plan_layers. In WGS84 degrees where the field has a place on the
        earth, else in metres. Raises RequestError where geopandas is not installed (the extra `geo`).
        """
        from planner.pipeline.outputs.plan_layers import build_plan_layers

        return build_plan_layers(self.context, self.run)

    def _find_best_drive(self) -> PlanDrive | None:
        best = self.ranking.best
        return None if best is None else self.pictures.get((best.strategy, best.tractors))

    def _find_picture(self) -> PlanDrive:
        """The drive of the best plan, or the field with the places where plans fail."""
        return self._find_best_drive() or build_refused_picture(self.context, self.ranking)

    def _render_page(self) -> str:
        drive = self._find_best_drive()
        field_picture = None if drive else self._find_picture()
        return render_plan_page(self.ranking, drive, self.pictures, field_picture)

    def _write_plan(self) -> str:
        if self.run is None:
            raise RequestError(
                "No plan is feasible, so there is no plan to save; .html and .png show where plans fail."
            )
        return write_saved_plan(self.context, self.run.plan, self.ranking)


def _start_stage(report_stage: StageReport | None, words: str, total: int = 0) -> Progress | None:
    """Report that a stage begins; what its progress is reported to."""
    if report_stage is None:
        return None
    report_stage(words, 0, total)
    return partial(report_stage, words)


def plan(
    request: PlanRequest,
    *,
    field: FieldChoice = None,
    tractor: Tractor | str | Path | None = None,
    implement: Implement | None = None,
    uncertainty: UncertaintySettings | None = None,
    cost_terms: CostTerms | None = None,
    supply: Supply | None = None,
    times: FarmTimes | None = None,
    yard: Yard | None = None,
    done: DoneSource | Path | Sequence[DoneSource | Path] = (),
    without: int | Sequence[int] = (),
    from_road: bool = False,
    executor: Executor | None = None,
    progress: Progress | None = None,
    report_stage: StageReport | None = None,
    with_pictures: bool = False,
    simulate_all: bool = False,
    time_share: TimeShare = NO_LIMIT,
) -> PlanningResult:
    """Simulate and rank every candidate of a request, and return the answer.

    Example:

        answer = headland.plan(headland.PlanRequest(field="denmark", tractors=(1, 2), start_s="07:00"))
        answer                             # in a notebook: the plan to take, its map, all plans in a table
        answer.ranking.best.time_s         # seconds of the best plan; ranking.best is None where no plan works
        answer.to_pandas()                 # a row per plan, as headland plan --csv
        answer.to_geodataframe()           # what the best plan drives and misses (needs geopandas)
        answer.save("best.json")           # the plan for headland show and export; also .html, .png, .csv

    Returns a PlanningResult: `ranking` (all plans, the best in `ranking.best`), `run` (the simulated run of the best
    plan), `plans` (legs and gates of every feasible plan by strategy and tractors), `pictures`, `context`.

    `field` and `tractor` (objects, names or files; for a field also shapes) replace those of the request; `implement`
    gives hitch and length, its width is that of the request. `uncertainty`, `cost_terms`, `times` and `yard` come from
    a farm, `supply` is what its implement carries. `done` is what is worked already, one or several of: a file of
    ground, logs, or a saved plan at a time ("plan.json@13:20"); the plan is for the rest, by the machines of that plan
    from where they stand, but for those `without` (numbers from 1), and its values are in place of all that the request
    leaves at their defaults, but for the field; with `from_road` the machines come in from outside.
    `executor` simulates the candidates, by default in fresh processes on all cores; the result does not depend on it.
    `progress` is called with (done, total), `report_stage` with the stage in words (LAYING_OUT, SIMULATING), done and
    total, which is 0 while it is unknown. Raises HeadlandError for a request that cannot be planned. A candidate that
    cannot be driven is ranked last with its reason; one that is estimated to be slower is pruned, except with
    `simulate_all`. A `time_share`, for executors in this thread, ends planning with what is found by
    then, without parts; TimeSpentError where no layout is.
    """
    if not isinstance(request, PlanRequest):
        raise TypeError(f"plan() takes a PlanRequest, such as PlanRequest(field='denmark'), not {request!r:.60}.")
    order = WorkOrder(
        request,
        field,
        tractor,
        implement,
        uncertainty,
        cost_terms,
        supply,
        times,
        yard,
        list_sources(done),
        list_numbers(without),
        from_road,
        simulates_all=simulate_all,
    )
    return plan_order(
        continue_order(order),
        executor=executor,
        progress=progress,
        report_stage=report_stage,
        with_pictures=with_pictures,
        time_share=time_share,
    )


def plan_order(
    order: WorkOrder,
    *,
    executor: Executor | None = None,
    progress: Progress | None = None,
    report_stage: StageReport | None = None,
    with_pictures: bool = False,
    time_share: TimeShare = NO_LIMIT,
    cache: ResultCache = NO_CACHE,
) -> PlanningResult:
    """Simulate and rank every candidate of a work order, as `plan` does; a `cache` has what earlier runs found."""
    with ExitStack() as opened:
        if executor is None:
            executor = opened.enter_context(create_executor(len(group_candidates(list_candidates(order.request)))))
        report_layouts = _start_stage(report_stage, LAYING_OUT)
        moves = None if cache.folder is None else MoveCache(cache)
        context = prepare_context(order, report_layouts=report_layouts, time_share=time_share, move_cache=moves)
        context = go_on(context, order)
        candidates = keep_continuing(context, list_candidates(order.request))
        check_margin(context, feasible=True)  # one that takes most of the field is refused even if plans are feasible
        report = progress if report_stage is None else _start_stage(report_stage, SIMULATING, len(candidates))
        prunes = not order.simulates_all and prunes_candidates(context)

        def compute(numbers: Sequence[int]) -> Outcomes:
            some, packed = [candidates[number] for number in numbers], pack_context(context)
            outcomes = iter_outcomes(executor, packed, some, report, prunes=prunes, with_pictures=with_pictures)
            return collect_outcomes((numbers[place], outcome) for place, outcome in outcomes)

        known = cache if time_share is NO_LIMIT else NO_CACHE
        outcomes = recall_outcomes(known, context, candidates, prunes, compute)
        result = _build_result(context, candidates, outcomes, with_pictures)
        if time_share is not NO_LIMIT:
            return result
        parts = tuple(_iter_part_plans(result, order, executor, cache))
        return replace(result, ranking=replace(result.ranking, parts=parts))


def _iter_part_plans(
    result: PlanningResult, order: WorkOrder, executor: Executor, cache: ResultCache
) -> Iterator[FieldPartPlan]:
    """The further parts of a divided field that are left, each with a plan of its own, if possible by the strategy and
    tractors of the best plan."""
    context, best = result.context, result.ranking.best
    request, field = context.request, context.layout.field
    if best is None or request.part is not None:
        return
    before = context.going_on
    width_m = measure_passage_m(context.tractor, context.implement)
    for part in list_field_parts(replace(field, done=None), request.margin_m, width_m)[1:]:
        alike = replace(
            request, part=part.number, strategies=(best.strategy,), tractors=(best.tractors,), **_UNASKED_OF_PARTS
        )
        done: tuple[DoneWork, ...] = ()  # the work in the part, as whoever comes there by road takes it
        if before is not None and not clip_area(before.ground, part.region).is_empty:
            done = (DoneWork(before.ground, before.error_m),)
        own_order = replace(order, request=alike, done=done, without=(), from_road=True, layout=None)
        try:
            own_plan, reason = _plan_part(own_order, executor, cache)
        except AllDoneError:
            continue
        assert part.neck is not None  # only the largest part has none
        left = subtract_area(part.region, field.done) if done else part.region
        ground = shapely.point_on_surface(left)
        yield FieldPartPlan(
            part.number,
            locate_piece(field, left.area, ground.x, ground.y),
            locate_piece(field, 0.0, part.neck.x_m, part.neck.y_m),
            part.neck.width_m,
            own_plan,
            None if own_plan is not None else reason,
        )


def _plan_part(order: WorkOrder, executor: Executor, cache: ResultCache) -> tuple[PlanResult | None, str | None]:
    """The best plan of an order for a part, by one tractor where there is none else; and why there is none.

    Raises AllDoneError.
    """
    single = replace(order, request=replace(order.request, strategies=STRATEGY_NAMES, tractors=(1,)))
    own_plan, reason = None, None
    for part_order in (order, single):
        try:
            ranking = plan_order(part_order, executor=executor, cache=cache).ranking
            own_plan, reason = ranking.best, next((each.reason for each in ranking.plans), None)
        except AllDoneError:
            raise
        except HeadlandError as refusal:
            reason = str(refusal)
        if own_plan is not None:
            break
    return own_plan, reason


def _build_result(
    context: PlanningContext,
    candidates: Sequence[Candidate],
    outcomes: Mapping[int, Outcome],
    with_pictures: bool,
) -> PlanningResult:
    """The answer from the outcomes of all candidates; those that time does not suffice for are refused."""
    if len(outcomes) < len(candidates):
        context.time_share.lift()
    refusal = PlanResult("", 0, context.request.turn, False, "planning ran out of time")
    results = [
        outcomes[number].result
        if number in outcomes
        else replace(refusal, strategy=candidate.strategy, tractors=candidate.tractors)
        for number, candidate in enumerate(candidates)
    ]
    ranking = add_machine_names(rank_plans(context, results), context.cost_terms)
    keys = [(candidate.strategy, candidate.tractors) for candidate in candidates]
    driven_pictures = None
    if with_pictures:
        pictures = {
            number: outcome.picture
            or build_run_picture(context, drive_plan(context, candidates[number], outcome.plan), outcome.result)
            for number, outcome in sorted(outcomes.items())
            if outcome.plan is not None and outcome.result.time_s is not None
        }
        driven_pictures = {keys[number]: picture for number, picture in pictures.items()}
    feasible = {number: one for number, one in sorted(outcomes.items()) if one.result.feasible}
    plans = {keys[number]: one.plan for number, one in feasible.items() if one.plan is not None}
    if ranking.best is None:
        return PlanningResult(context, ranking, None, driven_pictures, plans)
    best = Candidate(ranking.best.strategy, ranking.best.tractors)
    number = candidates.index(best)
    run = outcomes[number].run
    if run is None:  # it was known before, or only the final comparison made it the best
        run = drive_plan(context, best, plans[keys[number]])
    if context.criteria is not None:
        check_and_shares = check_best_plan(
            run,
            context.tractor,
            context.implement,
            context.criteria,
            terrain=context.physics.terrain,
            load=context.physics.driven_load,
        )
        ranking = replace(ranking, check_sentences=describe_check(*check_and_shares))
    return PlanningResult(context, ranking, run, driven_pictures, plans)


def add_machine_names(ranking: PlanRanking, cost_terms: CostTerms | None) -> PlanRanking:
    """The ranking with the names of the farm's tractor and implement, where a farm has them."""
    names: dict[str, Any] = {"implement": None}
    if cost_terms is not None and cost_terms.implement is not None:
        names["implement"] = cost_terms.implement.name
    if cost_terms is not None and cost_terms.tractor is not None:
        names["tractor"] = cost_terms.tractor.name
    if cost_terms is not None and cost_terms.learned_notes:
        names["learned"] = list(cost_terms.learned_notes)
        learned_notes = tuple(f"From the farm's own logs: {note}." for note in cost_terms.learned_notes)
        ranking = replace(ranking, assumptions=(*ranking.assumptions, *learned_notes))
    return replace(ranking, scenario={**ranking.scenario, **names})
