"""The programmes of a fleet on the work lines of a field: composed of moves that were driven well, then driven."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from fields.arrays import Flags, Floats
from planner.evaluation.candidates.figures import CandidateRun, name_main_turns
from planner.evaluation.candidates.fleet_deals import list_other_deals, sketch_tidily
from planner.evaluation.candidates.fleet_drive import FleetDriver, build_clearance_check
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.contact_places import describe_position
from planner.evaluation.site import get_site_moves, recall
from reports.common.plan_records import Remark, Stake
from reports.common.plan_results import MODEL_ERROR_SHARE
from strategies.formations.compose import Formation, describe_formation_share
from strategies.formations.formation_site import FleetOrder, FormationSite
from strategies.lines.line_wishes import LineWishes
from strategies.path_planning.errors import SOLITARY_STRATEGIES, StrategyError
from strategies.path_planning.turn_kinds import HEADLAND_FIRST
from strategies.programmes.driven_search import TourProblem
from strategies.programmes.move_table import MoveTable
from strategies.programmes.programme import (
    Programme,
    Sketch,
    build_plan,
    charge_waiting,
    clear_ways,
    make_programme,
    sketch_programme,
)
from strategies.programmes.site_moves import SiteMoves
from strategies.programmes.stages import add_order_gates, charge_order, find_first_tasks, list_stages, stagger_starts
from strategies.rules.dealing import LineDeal
from strategies.service_stops.programme_stops import build_stop_moves, estimate_served_s, stop_programme
from strategies.service_stops.stop_moves import StopMoves
from strategies.site.site import MISSED_FACTOR
from strategies.strategy_record import Strategy
from vehicle.missions.plan import REFILL, SWATH, Plan, PlanNotes
from vehicle.sim.path_conflicts import ClearanceCheck

SURE_SHARE = 0.998  # of what lines and moves take: a drive of all was quicker by 0.1 % at most
LEAST_PACE_SHARE = 0.1  # of the working speed on a straight: starting and braking alone leave far more
NO_BETTER = "Worked otherwise the field is done no better."
MENTIONED_M2 = 20.0  # of ground on lines that are left: less is no remark


@dataclass(frozen=True, eq=False)
class ComposedPlan:
    """A programme with the headland in an order ("" for any), and its plan, in which nobody gives way yet.

    Attributes:
        build: builds the plan.
        tractor_s: seconds of every tractor, by lines and moves, if it gives way to nobody.
        compose_anew: composes it with what its tractors waited in a run of its plan charged to the moves at which they
            did; raises StrategyError where they did not, or that does not work. None for a formation.
    """

    order: str
    programme: Programme
    build: Callable[[], Plan]
    tractor_s: list[float]
    compose_anew: Callable[[Plan, CandidateRun], ComposedPlan] | None = None

    @cached_property
    def plan(self) -> Plan:
        """The plan, built when it is asked for: most are never driven."""
        return self.build()

    @property
    def least_s(self) -> list[float]:
        """Seconds of every tractor at least."""
        return [SURE_SHARE * seconds for seconds in self.tractor_s]

    @property
    def left_factor(self) -> float:
        """What the plan counts for, as a share of its time: ground that is left weighs as much as in the search."""
        left_m2 = self.programme.left_m2
        worked_m2 = math.fsum(line.own_m2 for line in self.programme.table.lines) - left_m2
        return 1.0 + MISSED_FACTOR * left_m2 / max(worked_m2, 1.0)


@dataclass(frozen=True, eq=False)
class SketchedPlan:
    """A plan before anything is driven for it, with the headland in an order ("" for any).

    Attributes:
        tractor_s: about the seconds of every tractor.
        tours: the nodes of every tractor in order; empty for a formation.
        served_s: about the seconds of every tractor at service stops, on top of `tractor_s`.
        compose: composes it of moves that were driven well; raises StrategyError where that does not work.
        sketch_others: sketches the same with lines dealt otherwise, such as by who stands near where work goes on; None
            for such a sketch.
    """

    order: str
    tractor_s: list[float]
    compose: Callable[[], ComposedPlan]
    sketch_others: Callable[[], list[SketchedPlan]] | None = None
    tours: Sequence[Sequence[int]] = ()
    served_s: Sequence[float] = ()


SketchOrder = Callable[[str], SketchedPlan]
"""Sketches a plan with the headland first or last, "" for any."""


def weigh_order_s(order: str, seconds: float) -> float:
    """Seconds that a plan with the headland in an order is compared by with others of its strategy.

    Turns lie on the headland. Where it is finished first all of them lead over it, which is worth no gain in time that
    may be an error of the model.
    """
    return (1.0 + MODEL_ERROR_SHARE) * seconds if order == HEADLAND_FIRST else seconds


def does_wait(seconds: float, alone_s: float) -> bool:
    """Whether a plan takes longer than its tractors alone, by more than may be an error of the model."""
    return seconds > (1.0 + MODEL_ERROR_SHARE) * alone_s


def sketch_plans(context: PlanningContext, strategy: Strategy, tractors: int) -> list[SketchedPlan]:
    """A plan for every order of headland and swaths that is asked for, the best by `weigh_order_s` first.

    Raises StrategyError where there is none, or the lines do not suffice for that many tractors.
    """
    sketch, sketches, refusals = _choose_sketcher(context, strategy, tractors), list[SketchedPlan](), []
    for order in context.request.headland_orders or ("",):
        context.time_share.check()
        try:
            one = sketch(order)
        except StrategyError as refusal:
            refusals.append(refusal)
            continue
        notes = PlanNotes(strategy.name, order, tractors)
        sketches.append(_add_notes(context, one, notes))
    if not sketches:
        raise refusals[0]
    return sort_sketches(sketches)


def sort_sketches(sketches: Sequence[SketchedPlan]) -> list[SketchedPlan]:
    """Sketches of one strategy, the best by `weigh_order_s` first."""
    return sorted(sketches, key=lambda one: round(weigh_order_s(one.order, max(one.tractor_s)), 3))


def _add_notes(context: PlanningContext, sketch: SketchedPlan, notes: PlanNotes) -> SketchedPlan:
    """A sketch whose plan has notes, and those of other shares likewise."""
    others = sketch.sketch_others
    return replace(
        sketch,
        compose=partial(_compose_sketch, context, sketch.compose, notes),
        sketch_others=others and (lambda: [_add_notes(context, one, notes) for one in others()]),
    )


def _compose_sketch(context: PlanningContext, compose: Callable[[], ComposedPlan], notes: PlanNotes) -> ComposedPlan:
    """A composed plan with its notes, in which every tractor has work, or where some may rest any."""
    context.time_share.check()
    one = compose()
    may_rest = context.going_on is not None and context.going_on.may_rest
    programme, lines = one.programme, one.programme.table.lines
    if may_rest and all(lines[node // 2].is_place for tour in programme.tours for node in tour):
        left = [line for line in lines if not line.is_place]
        count, length_m = len(left), math.fsum(line.length_m for line in left)
        if not left:
            raise StrategyError("Everything is done, and nothing is left to plan.")
        raise StrategyError(
            f"Nothing more can be done: tracks and headland sides of {length_m:.0f} m in all remain ({count}), "
            "which are not worth a drive, or to which no way leads."
        )
    if not may_rest and not (programme.tours and all(programme.tours)):
        raise StrategyError(
            f"There is no work for tractor {notes.tractors} that is worth the drive; use fewer tractors or a "
            "narrower implement."
        )
    anew = one.compose_anew
    return replace(
        one,
        build=partial(_finish_plan, context, one, notes),
        compose_anew=anew and (lambda *driven: _compose_sketch(context, partial(anew, *driven), notes)),
    )


def _choose_sketcher(context: PlanningContext, strategy: Strategy, tractors: int) -> SketchOrder:
    """What sketches the plan of a strategy with the headland in a given order."""
    _check_pace(get_site_moves(context))
    rule = strategy.formation
    if rule is None or tractors == 1:
        return _deal_lines(context, strategy, tractors)
    if context.request.line_wishes:
        raise StrategyError(
            "Tractors in formation work all tracks side by side, and some are to be left out or worked first or by one "
            f"of them; use {SOLITARY_STRATEGIES}."
        )
    _check_supply_lasts(context, tractors)

    def form_up(order: str) -> SketchedPlan:
        site = recall(
            context, FormationSite, lambda: FormationSite(_require_lines(context), build_clearance_check(context, True))
        )
        fleet = FleetOrder(tractors, order, rule.in_rows)
        _check_tracks_suffice(context, tractors)

        def compose() -> ComposedPlan:
            formation = Formation(site.share(fleet), rule)
            return ComposedPlan(order, formation.programme, formation.build_plan, formation.compute_tractor_s())

        return SketchedPlan(order, Formation(site.sketch(fleet), rule).compute_tractor_s(), compose)

    return form_up


def _check_pace(moves: SiteMoves) -> None:
    """Raise StrategyError where no plan ends in time, as the tractor cannot work at anything like its speed."""
    pace_share = moves.drives.pace_share
    if pace_share < LEAST_PACE_SHARE:
        raise StrategyError(
            f"on level ground the tractor works at {100.0 * pace_share:.0f} % of the speed asked for, as power or grip "
            "are too little: use a narrower implement or another tractor"
        )


def _require_lines(context: PlanningContext) -> SiteMoves:
    """The moves of a site with work lines."""
    moves = get_site_moves(context)
    if not moves.lines and context.going_on is not None:
        raise StrategyError(
            f"What is left of the field ({context.layout.field.area_ha:.2g} ha) has no piece that is worth a drive for "
            "this machine; take the field as done."
        )
    if not moves.lines:
        raise StrategyError(
            "Nowhere on the field has this machine room to work a line; use a narrower or shorter implement, or a "
            "smaller margin."
        )
    return moves


def _check_tracks_suffice(context: PlanningContext, tractors: int) -> None:
    """Refuse a formation where fewer tracks are to be worked than it has tractors."""
    lines = _require_lines(context).lines
    tracks = {line.task.number for line in lines if line.task.kind == SWATH}
    if (count := len(tracks)) < tractors:
        raise StrategyError(
            f"{tractors} tractors in formation need {tractors} tracks, and there is work on {count}; use "
            f"{SOLITARY_STRATEGIES}."
        )


def _check_supply_lasts(context: PlanningContext, tractors: int) -> None:
    """Refuse a formation whose loads do not last for all lines: nobody in it can be served alone."""
    moves, supply = _require_lines(context), context.supply
    legs = [] if supply is None else [moves.build_work_leg(2 * number, 0.0) for number in range(len(moves.lines))]
    if supply is not None and supply.compute_legs_need(legs, moves.site.width_m) > tractors * supply.capacity:
        hectares = supply.capacity / supply.rate_per_m2 / 1e4
        raise StrategyError(
            f"Tractors in formation wait for each other, so none can be served alone, and {supply.load_text} lasts for "
            f"{hectares:.3g} ha of its share; use {SOLITARY_STRATEGIES}, or a larger "
            f"{'tank' if supply.service == REFILL else 'battery'}."
        )


def _deal_lines(context: PlanningContext, strategy: Strategy, tractors: int) -> SketchOrder:
    """Sketches the plan of a strategy that only says which lines each tractor may have; all are served in time.

    One tractor of a formation may have all; so may all where work goes on: who is near takes what is left.
    """
    moves, check = _require_lines(context), build_clearance_check(context, strategy.beside)
    if strategy.deal is None or context.going_on is not None:
        deal = LineDeal(np.ones((tractors, len(moves.lines)), bool))
    else:
        deal = strategy.deal(moves.lines, moves.site.rules, tractors)
    wishes = _settle_wishes(context, tractors)
    return lambda order: DealtLines(context, moves, check, wishes, order, deal, is_first=True).sketch()


@dataclass(frozen=True, eq=False)
class DealtLines:
    """The work lines of a site dealt to tractors, with the headland in an order: sketched, then composed.

    `is_first` is whether the deal is that of the strategy, and not one that takes its place where tractors wait.
    """

    context: PlanningContext
    moves: SiteMoves
    check: ClearanceCheck
    wishes: LineWishes
    order: str
    deal: LineDeal
    is_first: bool

    @cached_property
    def table(self) -> MoveTable:
        """What moves between the lines cost."""
        return MoveTable(self.moves)

    @cached_property
    def stages(self) -> Sequence[int]:
        """Which lines come first (n,)."""
        stages = list_stages(self.moves.site, self.moves.lines, self.order)
        return self.deal.rank(self.wishes.rank(self.moves.lines, stages))

    @cached_property
    def stop_moves(self) -> StopMoves | None:
        """Moves to the place where tractors are served; None where they are not, or without a place."""
        return None if self.context.supply is None else build_stop_moves(self.table, self.context.supply)

    @cached_property
    def served_s(self) -> Floats | None:
        """How long a tractor takes to be served for each line (n,); None where it is not."""
        supply = self.context.supply
        return None if supply is None else estimate_served_s(self.table, supply, self.stop_moves)

    def _pose_tours(self, allowed: Flags) -> TourProblem:
        """The search for tours of lines that each tractor may work (tractors, n)."""
        may = self.wishes.limit(self.moves.lines, allowed)
        goes_on = self.context.going_on is not None
        charged_s = charge_order(self.moves.site, self.moves.lines, self.order, may, goes_on=goes_on)
        return TourProblem(self.table, may, self.stages, charged_s, self.served_s, self.check)

    def sketch_tours(self, allowed: Flags) -> Sketch:
        """Tours by estimated moves, of lines that each tractor may work (tractors, n)."""
        return sketch_programme(self._pose_tours(allowed))

    def sketch(self) -> SketchedPlan:
        """The plan as sketched; by the deal of a strategy in a way that people would rather see (sketch_tidily)."""
        own = self.deal.allowed
        if self.is_first and len(own) > 1 and self.context.going_on is None:
            sketched, own = sketch_tidily(self.sketch_tours, self.moves, self.deal)
        else:
            sketched = self.sketch_tours(own)
        served_s = np.zeros(len(self.moves.lines)) if self.served_s is None else self.served_s
        return SketchedPlan(
            self.order,
            sketched.tractor_s,
            lambda: self._compose(self._pose_tours(own), sketched.tours),
            (lambda: self._sketch_others(is_tidy=own is not self.deal.allowed)) if self.is_first else None,
            tours=sketched.tours,
            served_s=[math.fsum(served_s[node // 2] for node in tour) for tour in sketched.tours],
        )

    def _sketch_others(self, *, is_tidy: bool) -> list[SketchedPlan]:
        """Sketches by other deals, that of the strategy alone first where the first sketch `is_tidy`."""
        goes_on, found = self.context.going_on is not None, list[SketchedPlan]()
        others = list_other_deals(self.sketch_tours, self.moves, self.deal, self.order, goes_on=goes_on)
        for deal in [self.deal, *others] if is_tidy else others:
            with suppress(StrategyError):
                found.append(replace(self, deal=deal, is_first=False).sketch())
        return found

    def _compose(self, problem: TourProblem, start: Sequence[Sequence[int]]) -> ComposedPlan:
        """The plan composed of moves that were driven well, in a search that begins with the tours `start`."""
        programme = make_programme(problem, start)
        supply, stagger_m = self.context.supply, self.deal.stagger_m
        stops = supply and any(programme.tours) and stop_programme(programme, supply, self.stop_moves, self.stages)

        def build() -> Plan:
            plan = clear_ways(stops.build_plan() if stops else build_plan(programme), self.table, self.check)
            return stagger_starts(plan, stagger_m) if stagger_m else plan

        def compose_anew(plan: Plan, driven: CandidateRun) -> ComposedPlan:
            waited_s = charge_waiting(programme, stops.list_nodes() if stops else programme.tours, plan, driven.run)
            if not waited_s.any():
                raise StrategyError(NO_BETTER)
            anew = self._compose(replace(problem, charged_s=problem.charged_s + waited_s), programme.tours)
            if anew.programme.tours == programme.tours:
                raise StrategyError(NO_BETTER)
            return anew

        return ComposedPlan(self.order, programme, build, programme.compute_tractor_s(), compose_anew)


def _settle_wishes(context: PlanningContext, tractors: int) -> LineWishes:
    """What is wanted of the lines of a context; where work goes on of those that are left, whoever works them."""
    wishes = context.request.line_wishes
    if context.going_on is not None:
        return replace(wishes, given=())
    wishes.check(get_site_moves(context).lines, tractors, max(context.request.tractors))
    return wishes


def _finish_plan(context: PlanningContext, composed: ComposedPlan, notes: PlanNotes) -> Plan:
    """A plan with its notes; tractors wait for one another between headland and swaths where its operation asks."""
    plan, table = composed.plan, composed.programme.table
    strategy, headland, tractors = notes.strategy, notes.headland, notes.tractors
    plan = replace(plan, notes=replace(plan.notes, strategy=strategy, headland=headland, tractors=tractors))
    is_kept = composed.order != HEADLAND_FIRST
    if not (table.site.keeps_ground if is_kept else table.site.crop_stands):
        return plan
    first = find_first_tasks(table.site, table.lines, composed.order)
    return add_order_gates(plan, table.site, first, context.tractor.width_m, is_kept=is_kept)


def drive_composed(context: PlanningContext, driver: FleetDriver, composed: ComposedPlan) -> CandidateRun:
    """The run of a composed plan, with what is known of it without measuring."""
    run, reason = driver.drive(composed.plan)
    table = composed.programme.table
    moves = (table.get_move(u, v) for u, v in composed.programme.list_pairs())
    turns = Counter(move.kind for move in moves if move is not None and not move.is_work)
    left, apart = list_left_remarks(composed.programme, context), describe_formation_share(composed.plan)
    left += _list_machine_remarks(composed, context)
    return CandidateRun(
        run, reason, name_main_turns(turns), (*left, *([] if apart is None else [Remark(Stake.NOTHING, apart)]))
    )


def _list_machine_remarks(composed: ComposedPlan, context: PlanningContext) -> tuple[Remark, ...]:
    """Who of a plan has no work, and which tractors are others of the plan before."""
    missions, tractors = composed.plan.missions, len(composed.programme.tours)
    without = [number for number, mission in enumerate(missions, start=1) if not mission.works]
    idle = " and ".join(map(str, (*without, *range(len(missions) + 1, tractors + 1))))
    texts = [f"no work that is left is worth the drive for tractor {idle}"] if idle else []
    before = () if context.going_on is None else context.going_on.numbers[:tractors]
    texts += [
        f"tractor {place} is tractor {number} of the plan before"
        for place, number in enumerate(before, start=1)
        if place != number
    ]
    return tuple(Remark(Stake.NOTHING, text) for text in texts)


def list_left_remarks(programme: Programme, context: PlanningContext) -> tuple[Remark, ...]:
    """Remarks on the lines that are left, with their area and the place of the largest; empty without any to tell."""
    lines = programme.table.lines
    wanted = set(context.request.line_wishes.find_left_out(lines))
    left = [lines[number] for number in programme.left if number not in wanted]
    left_m2 = math.fsum(line.own_m2 for line in left)
    if left_m2 < MENTIONED_M2:
        return ()
    count = "1 line of work is" if len(left) == 1 else f"{len(left)} lines of work are"
    x_m, y_m = np.mean(max(left, key=lambda line: line.own_m2).paths[0], axis=0).tolist()
    where = f"{'in all, the largest ' if len(left) > 1 else ''}{describe_position(x_m, y_m, context)}"
    text = f"{count} left ({left_m2:.0f} m2 {where}): out of reach of this machine, or not worth the drive"
    return (
        Remark(Stake.WORK, text),
        Remark(Stake.WORK, "a smaller turning radius or a narrower implement may help"),
    )
