"""One candidate from strategy to figures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fields.layout import Layout
from planner.candidates.alone import Alone, patience_s
from planner.candidates.beaten import Beaten, Rival, contenders, from_any_corner, quickest_of, result_of, surely
from planner.candidates.bounds import pace_of
from planner.candidates.choosing import Limits, best_first, untried
from planner.candidates.headland import headland_s, with_headland
from planner.candidates.other_orders import TOLD, other_orders
from planner.candidates.refills import check_leave, crowded, refilled
from planner.candidates.slowing import Cured, cured_turns, cures, left_m, mended, with_cured
from planner.candidates.steady import ASIDE_M, Slip, slips, worst_aside
from planner.candidates.within_reach import built_within_reach
from planner.ground.measure import Coverage, coverage, excursion, finite_or_none, outline_excursion_m, reversals
from planner.ground.swept import swept_ground
from planner.ground.touched import fence_crossed_m, obstacle_touched
from planner.ground.trampled import trampled_m2
from planner.outlook import with_outlook
from planner.price.cost import as_simulated, coming_and_going
from planner.scenario import LEAST_CLEARANCE_M
from planner.site import ROOM_KEPT, Site
from planner.yielding.deconflict import GiveWay, without_conflicts
from planner.yielding.giving_way import Rules, Scheduled, giving_way
from reports.results import PlanResult, done_s
from strategies.errors import StrategyError
from strategies.formations.grouping import Corner
from strategies.formations.promise import corners_by_promise
from strategies.job import Job
from strategies.record import Refined, Simulate, Strategy
from strategies.registry import STRATEGIES
from vehicle.missions import ROUND, Plan
from vehicle.rehearsal import Rehearsal
from vehicle.run import DONE, Run

FARTHEST_OUTSIDE_M = 0.5
FARTHEST_ASIDE = 1.0 / 3.0  # of the working width: more leaves a strip that nobody works
CROSSED_M = 0.02  # a width of wire
LOST_ASIDE, LOST_M = 1.0, 2.5  # working widths and metres: who begins farther aside than both has lost its line
SMALLEST_GAIN_M = 0.02
SAME_LINE_M = 1e-3


@dataclass(frozen=True)
class Candidate:
    """A combination to try; `jump` fixes the pattern of tracks for a strategy that takes one."""

    strategy: str
    tractors: int
    jump: int | None = None


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The figures of a candidate, and the run they were measured on; None where its strategy refused the field."""

    result: PlanResult
    run: Run | None


@dataclass(frozen=True, eq=False)
class CandidateRun:
    """The last run of a candidate, why it is not feasible (None when it is), the turns it uses, its remark."""

    run: Run
    reason: str | None
    turns: str
    remark: str | None


def evaluate(site: Site, candidate: Candidate) -> PlanResult:
    """The figures of `simulated` alone."""
    return simulated(site, candidate).result


def simulated(site: Site, candidate: Candidate, rival: Rival | None = None) -> Evaluation:
    """Build, simulate, repair and measure one candidate; a refusal becomes a result with its reason.

    One that is found to be no match for a rival when its plans are written is not driven.
    """
    try:
        tried = _tried(site, candidate, rival)
    except StrategyError as refusal:
        turn = site.scenario.turn
        return Evaluation(PlanResult(candidate.strategy, candidate.tractors, turn, False, str(refusal)), None)
    if isinstance(tried, Beaten):
        return Evaluation(result_of(tried, site, candidate.strategy, candidate.tractors), None)
    result, area_ha = _measured(site, candidate, tried), site.layout.field.area_ha
    return Evaluation(
        with_outlook(result, tried.run, site.tractor, site.implement, area_ha, site.stakes), tried.run
    )


def run_candidate(site: Site, candidate: Candidate) -> CandidateRun:
    """Build, simulate and repair one candidate; raises StrategyError where its strategy cannot work the field."""
    tried = _tried(site, candidate, None)
    assert isinstance(tried, CandidateRun)
    return tried


def _tried(site: Site, candidate: Candidate, rival: Rival | None) -> CandidateRun | Beaten:
    """The run of a candidate, or how a rival beats it."""
    strategy = STRATEGIES[candidate.strategy]
    if candidate.jump is not None and not strategy.takes_jump:
        raise StrategyError(f"Strategy {strategy.name!r} has its own order of tracks; leave out the jump.")
    job = replace(site.job(candidate.tractors), jump=candidate.jump)
    return (_from_some_corner if strategy.abreast else _in_some_order)(site, strategy, job, rival)


def _from_some_corner(site: Site, strategy: Strategy, job: Job, rival: Rival | None) -> CandidateRun | Beaten:
    """A formation from the corner at the entrance, or else the one that promises most, of those that can be driven."""
    first: CandidateRun | None = None
    refusal: StrategyError | None = None
    for corner in corners_of(job):
        try:
            latest = _run_job(site, strategy, replace(job, corner=corner, used={}), rival)
        except StrategyError as error:
            refusal = refusal or error
            continue
        if isinstance(latest, Beaten) or latest.reason is None:
            return latest
        first = first or latest
    if first is None:
        raise refusal or StrategyError("No corner to begin at; the field has no tracks.")
    return first


def _in_some_order(site: Site, strategy: Strategy, job: Job, rival: Rival | None) -> CandidateRun | Beaten:
    """Tractors with tracks of their own in the order found first, or else in another that can be driven."""
    first: CandidateRun | None = None
    told: Beaten | None = None
    refusal: StrategyError | None = None
    for number, other in enumerate((job, *other_orders(strategy, job))):
        try:
            latest = _run_job(site, strategy, other, rival)
        except StrategyError as error:
            refusal = refusal or error
            continue
        if isinstance(latest, CandidateRun) and latest.reason is None:
            return replace(latest, remark=_joined(latest.remark, TOLD)) if number else latest
        if isinstance(latest, CandidateRun):
            first = first or latest
        elif not number and not latest.driven:
            return latest
        elif not number or (told and latest.seconds < told.seconds):
            told = latest
    if told is not None:
        return told
    if first is None:
        assert refusal is not None  # an order is driven, beaten or refused
        raise refusal
    return first


def corners_of(job: Job) -> Iterator[Corner]:
    """The corner at the entrance, then the others, the most promising first; that is found out only where it counts."""
    if job.corner is not None:
        yield job.corner
    yield from (corner for corner in corners_by_promise(job) if corner != job.corner)


def _run_job(site: Site, strategy: Strategy, job: Job, rival: Rival | None) -> CandidateRun | Beaten:
    rehearsal = Rehearsal(
        site.tractor, site.implement, stop_clearance_m=site.scenario.clearance_m,
        beside_clearance_m=beside_clearance_m(site), position_errors=site.position_errors, seed=site.scenario.seed,
    )  # fmt: skip

    def simulate(plan: Plan) -> Run:
        return rehearsal.simulate(plan, patience_s(plan))

    def build(job: Job) -> Refined:
        refine = strategy.refine
        return refine(job, simulate, site.tractor, site.implement) if refine else Refined(strategy.build(job))

    check_leave(job, strategy)
    alone = Alone(site, rehearsal)
    give_way = _give_way(site, alone)
    limits = Limits(pace_of(site.tractor, site.implement, site.manner.radius_m), alone)
    refined, reached = built_within_reach(job, build)
    job, refined = reached.job, replace(refined, remark=_joined(refined.remark, reached.told))
    first: CandidateRun | None = None
    slower: Beaten | None = None
    tried: list[Plan] = []
    cured: Cured = {}

    def drive(choice: Refined) -> CandidateRun:
        plan = with_cured(choice.plan, cured, site)
        if plan is not choice.plan:
            one = _run_plan(site, strategy, job, replace(choice, plan=plan, run=None), simulate, give_way, cured)
            if one.reason is None:
                return one
        return _run_plan(site, strategy, job, choice, simulate, give_way, cured)

    for dry in with_headland(site, job, refined):
        every = refilled(job, strategy, dry)
        choices = left = untried(every, tried)
        alone.expect(choice.plan for choice in choices)
        if rival and not (first and strategy.abreast):  # another corner might do with the first passage
            left, found = contenders(site, choices, rival, alone)
            lost = not left and len(choices) == len(every)
            if strategy.abreast and found is not None and lost and surely(found):
                return from_any_corner(found)
            if strategy.abreast:
                left = choices
            else:
                slower = quickest_of(slower, found)
            if slower is not None and lost:
                return replace(slower, driven=first is not None)
        runs = best_first(left, choices, drive, limits)
        driven = [each for each in runs if each.reason is None]
        if driven:
            return min(driven, key=lambda each: round(each.run.duration_s, 3))
        first = first or next(iter(runs), None)
        tried += [each.plan for each in left]
    assert first is not None  # a plan that cannot be written is refused
    return first if slower is None else replace(slower, driven=True)


def _give_way(site: Site, alone: Alone) -> GiveWay:
    """Schedules plans of this site."""
    rules = Rules(
        site.tractor, site.implement, site.scenario.clearance_m, beside_clearance_m(site), alone, site.driven
    )  # fmt: skip

    def give_way(plan: Plan, slack: float) -> Scheduled | None:
        alone.expect_also(plan)
        return giving_way(plan, rules, slack)

    return give_way


def _run_plan(
    site: Site, strategy: Strategy, job: Job, refined: Refined, simulate: Simulate, give_way: GiveWay,
    cured: Cured | None = None,
) -> CandidateRun:  # fmt: skip
    repairs = strategy.most_repairs
    run, reason = _driven(refined, simulate, repairs, give_way)
    if reason is None:
        run, worst = _steadied(site, refined.plan, run, simulate, repairs, give_way, cured)
        reason = _fault(site, run, worst) or crowded(run, job)
    told = [] if reason else _told(site, run, worst)
    return CandidateRun(run, reason, _turns(job), _joined(refined.remark, *told))


def _joined(*remarks: str | None) -> str | None:
    """Several remarks as one; None where there is none."""
    return "; ".join(each for each in remarks if each) or None


def _told(site: Site, run: Run, worst: Slip | None) -> list[str]:
    """What a reader would not expect of the run of a feasible plan."""
    told = []
    if run.min_clearance_m < site.scenario.clearance_m:
        told.append(
            f"side by side on neighbouring tracks tractors come within {run.min_clearance_m:.2f} m of each other, as "
            f"some of these leave only {max(0.0, _between_m(site)):.2f} m between machines"
        )
    if loosened := run.plan.notes.get("loosened"):
        times = "once" if loosened == 1 else f"{loosened} times"
        told.append(f"{times} tractors go on before one that could not get past them is in place")
    if worst is not None and worst.metres > FARTHEST_ASIDE * site.layout.width_m:
        told.append(f"{_begun(run, worst)}; what that leaves open is counted as missed")
    return told


def _begun(run: Run, slip: Slip) -> str:
    kind = run.plan.missions[slip.tractor].legs[slip.leg].task.kind
    return f"a {'side of a round' if kind == ROUND else 'track'} is begun {slip.metres:.2f} m beside its line"


def beside_clearance_m(site: Site) -> float:
    """How near two may come beside each other on parallel lines: neighbouring tracks leave no more than they do."""
    return min(max(ROOM_KEPT * _between_m(site), LEAST_CLEARANCE_M), site.scenario.clearance_m)


def _between_m(site: Site) -> float:
    """What neighbouring tracks leave between machines on their lines (m); negative where they leave nothing."""
    return _spacing_m(site.layout) - max(site.implement.contact_width_m, site.tractor.width_m)


def _spacing_m(layout: Layout) -> float:
    """How far apart neighbouring tracks are at the least: where lines are shared out evenly, less than their width."""
    spacing = layout.width_m
    for before, track in pairwise(layout.tracks):
        ends = np.array([track.start, track.end]) - before.start
        along = (np.array(before.end) - before.start) / before.length
        apart = np.abs(along[0] * ends[:, 1] - along[1] * ends[:, 0])
        if track.line == before.line + 1 and np.ptp(apart) < SAME_LINE_M and apart[0] > 0.5 * layout.width_m:
            spacing = min(spacing, float(apart[0]))
    return spacing


def _driven(refined: Refined, simulate: Simulate, most_repairs: int, give_way: GiveWay) -> tuple[Run, str | None]:
    """The run of a plan with tractors giving way, and why it is not feasible when it is not."""
    if refined.run is not None and refined.run.outcome == DONE:
        return refined.run, None
    return without_conflicts(refined.plan, simulate, most_repairs, give_way)


def _steadied(
    site: Site, plan: Plan, run: Run, simulate: Simulate, most_repairs: int, give_way: GiveWay,
    known: Cured | None = None,
) -> tuple[Run, Slip | None]:  # fmt: skip
    """The run with turns that it followed badly driven otherwise where that helps, and the worst that is left.

    What helped is added to what is `known`.

    Where tractors meet with the gates of the run, and a turn leaves the field, `plan` as it was before it had gates
    is given others.

    Where the headland is worked and missed ground is charged, what is left open beside a track begun less than a third
    of the width aside costs less than driving more carefully.
    """
    turns = slips(run, site)
    most_m = max(ASIDE_M, FARTHEST_ASIDE * site.layout.width_m) if site.rounds else ASIDE_M
    cured = cures(run.plan, [slip for slip in turns if slip.metres > most_m or slip.outside], site)
    if cured and left_m(turns, cured) <= left_m(turns) - SMALLEST_GAIN_M:
        again, fault = without_conflicts(mended(run.plan, cured), simulate, most_repairs, give_way)
        if fault and plan is not run.plan and any(cure.slip.outside for cure in cured):
            again, fault = without_conflicts(mended(plan, cured), simulate, most_repairs, give_way)
        left = turns if fault else slips(again, site)
        if left_m(left) <= left_m(turns) - SMALLEST_GAIN_M and worst_aside(left) <= worst_aside(turns):
            if known is not None:
                known |= cured_turns(run.plan, cured, site)
            run, turns = again, left
    return run, max(turns, key=lambda slip: slip.metres, default=None)


def _fault(site: Site, run: Run, worst: Slip | None) -> str | None:
    """Why a plan that was driven to the end is not feasible all the same, or None.

    `worst` is the track or side of a round that was begun farthest beside its line. Where the headland is worked too,
    ground that is left open there is measured and charged like any other, and only who has lost the line is refused.
    """
    if run.contacts:
        time, first, second = run.contacts[0]
        return f"tractors {first + 1} and {second + 1} touch after {time:.0f} s"
    outside = excursion(run, site).depth_m
    if outside >= FARTHEST_OUTSIDE_M:
        return f"a path leaves the field by {outside:.2f} m, {FARTHEST_OUTSIDE_M} m or more"
    crossed = fence_crossed_m(run, site)
    if crossed > CROSSED_M:
        what = "a tractor or its implement crosses the fence"
        return f"{what} by {crossed:.2f} m; use a deeper headland or keep a wider margin"
    if touched := obstacle_touched(run, site):
        return f"a tractor or its implement touches {touched}; use a deeper headland or keep a wider margin"
    width = site.layout.width_m
    if worst is not None and not site.rounds and worst.metres > FARTHEST_ASIDE * width:
        return f"{_begun(run, worst)}, more than a third of the working width"
    if worst is not None and worst.metres > max(LOST_ASIDE * width, LOST_M):
        return f"{_begun(run, worst)}, more than a working width: the tractor has lost it"
    return None


def _turns(job: Job) -> str:
    """The two kinds of turn driven most, the commonest first."""
    return "+".join(sorted(job.used, key=lambda kind: (-job.used[kind], kind))[:2]) or "none"


def _measured(site: Site, candidate: Candidate, tried: CandidateRun) -> PlanResult:
    run, reason, turn = tried.run, tried.reason, tried.turns
    outside = excursion(run, site)
    if run.outcome != DONE:
        return PlanResult(
            candidate.strategy, candidate.tractors, turn, False, reason, collisions=len(run.contacts)
        )
    shares, swept = run.time_shares(), swept_ground(run, site)
    worked = coverage(run, site, swept)
    tractor_time = float(np.sum(run.finish_s))
    hourly, hiring = _prices(site, run)
    figures = PlanResult(
        strategy=candidate.strategy,
        tractors=candidate.tractors,
        turn=turn,
        feasible=reason is None,
        reason=reason,
        time_s=run.duration_s,
        tractor_time_s=tractor_time,
        cost=hourly + hiring,
        worked_pct=worked.worked_pct,
        overlap_pct=worked.overlap_pct,
        missed_m2=worked.missed_m2,
        largest_missed=worked.largest,
        finished_s=worked.finished(run.duration_s),
        finished_cost=worked.finished(hourly) + hiring,
        trampled_m2=trampled_m2(run, site, swept),
        outside_m=outside.length_m,
        excursion_m=outside.depth_m,
        outside_outline_m=outline_excursion_m(run, site),
        turning_s=float(shares["turning"].sum() + shares["reversing"].sum()),
        waiting_s=float(shares["waiting"].sum()),
        reversals=reversals(run),
        min_clearance_m=finite_or_none(run.min_clearance_m),
        collisions=len(run.contacts),
        order_gap_pct=run.plan.notes.get("order_gap_pct"),
        formation_pct=run.plan.notes.get("formation_pct"),
        remark=tried.remark,
        rounds=site.layout.rounds,
        headland_s=headland_s(run),
        refills=None if site.supply is None else len(run.plan.notes.get("refills", ())),
        refilling_s=None if site.supply is None else float(run.standing_s.sum()),
    )
    return _by_clock(figures, site, run, worked)


def _prices(site: Site, run: Run) -> tuple[float, float]:
    """What the work costs and what bringing the tractors does: as a farm accounts for it, or at the hourly price."""
    tractors, scenario = run.plan.tractors, site.scenario
    if site.terms is not None:
        coming = tractors * coming_and_going(site.terms)
        return as_simulated(run, site.terms) - coming, coming
    return run.duration_s * tractors / 3600.0 * scenario.price_per_hour, tractors * scenario.price_per_tractor


def _by_clock(figures: PlanResult, site: Site, run: Run, worked: Coverage) -> PlanResult:
    """The figures with when field work can begin, is done, would be done of the whole field, and all are home."""
    done, day, allowed = run.worked_s, site.day, site.scenario.allowed_s
    if day is None:
        timed = replace(figures, done_s=done, finished_done_s=worked.finished(done))
    else:
        first = day.before_s
        timed = replace(
            figures,
            transport_s=run.plan.tractors * (first + day.after_s),
            ready_s=day.clock_s(first, begins=True),
            done_s=day.clock_s(first + done),
            finished_done_s=day.clock_s(first + worked.finished(done)),
            home_s=day.clock_s(first + run.duration_s + day.after_s),
        )
    return replace(timed, meets_deadline=None if allowed is None else done_s(timed) <= allowed)
