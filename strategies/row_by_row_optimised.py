"""Row-by-row with optimised waiting times (thesis, section 6.3.2).

The headland is cut into segments along its length. A simulated row-by-row run shows when, after its release, each
tractor is on each segment; a constraint program (OR-Tools CP-SAT) finds the releases that bring the whole formation
into place soonest with no segment in use twice at a time. The releases become gates on how far the others have
driven, and the plan is simulated; where tractors come too close, the segments are reserved for longer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

from strategies.formations.compose import FormationRule, compose_formation
from strategies.formations.formation import (
    MAX_FORMATION_REPAIRS,
    Formation,
    build_formation,
    describe_formation_share,
    find_target_rounds,
    repair_formation,
)
from strategies.formations.grouping import NO_CHANGES, FormationChanges
from strategies.formations.queue_rules import leave_when_clear
from strategies.formations.queueing import FormationDraft, build_release_gate
from strategies.formations.release_times import HeadlandPassage, ReleaseDistances, measure_passages, optimise_releases
from strategies.formations.slots import FormationSlot
from strategies.program.field_job import FieldJob
from strategies.program.strategy_record import RefinedPlan, Simulate, Strategy
from strategies.row_by_row import form_row_by_row
from vehicle.missions.plan import Leg, LegGate, Mission, Plan
from vehicle.missions.run import DONE
from vehicle.model.tractor import Implement, Tractor

NAME = "row-by-row-optimised"
SINGLE_TRACTOR_REMARK = "a single tractor has nobody to wait for: driven as row-by-row"
NOT_QUICKER_REMARK = "optimised waiting was not quicker: driven as row-by-row"
HOLDS_S = (0.0, 1.0, 2.0, 4.0)


def form_timed_rows(job: FieldJob, releases: ReleaseDistances, changes: FormationChanges = NO_CHANGES) -> Formation:
    """Row by row with the given releases instead of the queue; nobody moves up in the queue."""

    def build_release_gates(draft: FormationDraft, number: int, slot: FormationSlot) -> list[LegGate]:
        waits_for = releases.get((number, slot.tractor), ())
        return [
            build_release_gate(draft.legs[other_tractor], draft.marks[number, other_tractor], other_tractor, distance_m)
            for other_tractor, distance_m in waits_for
        ]

    return build_formation(job, NAME, build_release_gates, move_up=False, changes=changes)


def refine_optimised(job: FieldJob, simulate: Simulate, tractor: Tractor, implement: Implement) -> RefinedPlan:
    """The timed plan and its run; the plain row-by-row plan where the timed one is not quicker or not feasible."""
    queue_run = repair_formation(lambda changes: form_row_by_row(job, changes=changes), simulate)
    plain_refined = queue_run.refined
    if job.tractors == 1:
        return replace(plain_refined, remark=SINGLE_TRACTOR_REMARK)
    fallback = replace(
        plain_refined, remark="; ".join(remark for remark in (NOT_QUICKER_REMARK, plain_refined.remark) if remark)
    )
    if plain_refined.run is None:
        return fallback
    if max(slot.row for _, slot in queue_run.formation.slots) > 2:  # with fewer rows nobody moves up in the queue
        queue_run = repair_formation(
            lambda changes: form_row_by_row(job, move_up=False, changes=changes), simulate, queue_run
        )
    queued_formation, measured_plan, run = queue_run.formation, queue_run.refined.plan, queue_run.refined.run
    if run is None:
        return fallback

    def measure_round(number: int) -> list[HeadlandPassage]:
        return measure_passages(job, queued_formation, run, number, tractor, implement)

    timed_refined = _refine_timed(job, queued_formation, measured_plan, simulate, measure_round)
    return (
        timed_refined
        if timed_refined and timed_refined.run and timed_refined.run.duration_s < plain_refined.run.duration_s
        else fallback
    )


def _refine_timed(
    job: FieldJob,
    queued_formation: Formation,
    measured_plan: Plan,
    simulate: Simulate,
    measure_round: Callable[[int], list[HeadlandPassage]],
) -> RefinedPlan | None:
    """The plan with optimised releases, simulated; None if it cannot be driven.

    In a round in which tractors meet the segments are held longer, at last the queue is used as measured. Rounds
    reached from afar or driven by one tractor alone are not changed.
    """
    base_formation = form_timed_rows(job, {}, queued_formation.changes)
    timings = {
        number: _ReleaseTiming(queued_formation.rounds[number], measure_round(number), number)
        for number in range(1, len(queued_formation.rounds))
        if not queued_formation.from_afar[number] and len(queued_formation.rounds[number]) > 1
    }
    for _ in range(1 + len(HOLDS_S) * len(timings)):
        legs = {
            leg_key: leg
            for timing in timings.values()
            for leg_key, leg in timing.build_released_legs(base_formation, measured_plan).items()
        }
        plan = _replace_legs(base_formation.plan, legs)
        run = simulate(plan)
        if run.outcome == DONE:
            return RefinedPlan(plan, run, describe_formation_share(plan))
        conflict_rounds = set(find_target_rounds(base_formation, run.conflict)) if run.conflict else set()
        held_longer = [timing.take_next_hold() for number, timing in timings.items() if number in conflict_rounds]
        if not any(held_longer):
            return None
    return None


def _replace_legs(plan: Plan, legs: Mapping[tuple[int, int], Leg]) -> Plan:
    """The plan with some of its legs replaced, by (tractor, leg number)."""
    return replace(
        plan,
        missions=tuple(
            Mission(tuple(legs.get((tractor, number), leg) for number, leg in enumerate(mission.legs)))
            for tractor, mission in enumerate(plan.missions)
        ),
    )


@dataclass
class _ReleaseTiming:
    """The releases of one round as they are tried; `holds_tried` counts the holds that were too short."""

    slots: tuple[FormationSlot, ...]
    passages: list[HeadlandPassage]
    round_number: int
    holds_tried: int = 0
    legs: dict[tuple[int, int], Leg] = field(default_factory=dict)

    def take_next_hold(self) -> bool:
        """Take the next hold, after the last one the plain queue; False if that was tried too."""
        if self.holds_tried == len(HOLDS_S):
            return False
        self.holds_tried, self.legs = self.holds_tried + 1, {}
        return True

    def build_released_legs(self, base_formation: Formation, measured_plan: Plan) -> dict[tuple[int, int], Leg]:
        """The legs with which the tractors of the round leave the queue, with their gates, by (tractor, leg number)."""
        if not self.legs:
            waits = (
                {}
                if self.holds_tried == len(HOLDS_S)
                else optimise_releases(self.round_number, self.passages, self.slots, HOLDS_S[self.holds_tried])
            )
            for slot in self.slots:
                release_leg = base_formation.marks[self.round_number, slot.tractor].release_leg
                gates = [
                    build_release_gate(
                        base_formation.plan.missions[other_tractor].legs,
                        base_formation.marks[self.round_number, other_tractor],
                        other_tractor,
                        distance_m,
                    )
                    for other_tractor, distance_m in waits.get((self.round_number, slot.tractor), ())
                ]
                if self.holds_tried == len(HOLDS_S):
                    gates = list(measured_plan.missions[slot.tractor].legs[release_leg].gates)
                self.legs[slot.tractor, release_leg] = (
                    base_formation.plan.missions[slot.tractor].legs[release_leg].copy_with_gates(gates)
                )
        return self.legs


STRATEGY = Strategy(
    name=NAME,
    description="the same, with release times found by constraint programming; it says so where none is quicker",
    build=lambda job: form_row_by_row(job).plan,
    side_by_side=True,
    refine=refine_optimised,
    max_repairs=MAX_FORMATION_REPAIRS,
    build_bound=lambda job: form_timed_rows(job, {}).plan,
    compose=partial(compose_formation, rule=FormationRule(NAME, leave_when_clear, move_up=False)),
)
