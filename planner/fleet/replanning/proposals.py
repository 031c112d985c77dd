"""Proposals of new plans for one fleet: in planning, ready, or accepted."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from typing import Any

from planner.errors import HeadlandError, render_refusal
from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.manager.remaining_work import RemainingWork, extract_remaining_work
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.rules import FleetManagerError
from planner.fleet.model.timed_mission import encode_leg
from planner.fleet.replanning.planning_anew import ReplanProposal, continue_remaining_work

RunInProcess = Callable[..., Awaitable[Any]]
BroadcastFrame = Callable[[dict[str, Any]], None]
MOST_PROPOSALS = 5
PROPOSAL_FIGURES = ("eta_s", "reassigned_m", "unreachable_m", "blocked_m")


@dataclass(frozen=True)
class _ProposalRecord:
    id: int
    state: str
    remaining: RemainingWork
    proposal: ReplanProposal | None = None
    sentence: str | None = None


class ReplanProposals:
    """Proposals by number; `run_in_process` runs a function in a process of its own and can be awaited."""

    def __init__(self, run_in_process: RunInProcess | None = None) -> None:
        self._run_in_process = run_in_process
        self._items: dict[int, _ProposalRecord] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._last = 0

    def start_replanning(self, manager: FleetManager, without: list[int], now: float, broadcast: BroadcastFrame) -> int:
        """Start planning all work that is left anew; watchers are shown the proposal when ready.

        Raises FleetManagerError.
        """
        if self._run_in_process is None:
            raise FleetManagerError("This fleet cannot be replanned here; drive it through the service.")
        if any(item.state == "planning" for item in self._items.values()):
            raise FleetManagerError("A proposal is already being planned; wait for it.")
        remaining = extract_remaining_work(manager, without, now)
        self._last += 1
        replan_run = _ProposalRecord(self._last, "planning", remaining)
        self._store_and_show(replan_run, broadcast)
        planning = self._compute_proposal(self._run_in_process, replan_run, broadcast)
        task = asyncio.get_running_loop().create_task(planning)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return replan_run.id

    async def _compute_proposal(
        self, run_in_process: RunInProcess, replan_run: _ProposalRecord, broadcast: BroadcastFrame
    ) -> None:
        try:
            proposal: ReplanProposal = await run_in_process(continue_remaining_work, replan_run.remaining)
            replan_run = replace(replan_run, state="ready", proposal=proposal, sentence=proposal.sentence)
        except HeadlandError as refusal:
            replan_run = replace(replan_run, state="failed", sentence=render_refusal(refusal))
        except Exception as error:
            replan_run = replace(replan_run, state="failed", sentence=f"Planning failed ({error}); try again.")
        self._store_and_show(replan_run, broadcast)

    def _store_and_show(self, replan_run: _ProposalRecord, broadcast: BroadcastFrame) -> None:
        self._items[replan_run.id] = replan_run
        for old in sorted(self._items)[:-MOST_PROPOSALS]:
            del self._items[old]
        broadcast(_build_proposal_frame(replan_run))

    def get_ready_proposal(self, number: int) -> tuple[RemainingWork, FleetPlan]:
        """The remaining work and the plan of a proposal that is ready. Raises FleetManagerError."""
        replan_run = self._items.get(number)
        if replan_run is None or replan_run.proposal is None or replan_run.state != "ready":
            raise FleetManagerError(f"Proposal {number} is not ready; replan first.", parameter="proposal")
        return replan_run.remaining, replan_run.proposal.plan

    def mark_accepted(self, number: int, broadcast: BroadcastFrame) -> None:
        """Mark a proposal as the plan that is driven now."""
        self._store_and_show(replace(self._items[number], state="accepted"), broadcast)

    def list_frames(self) -> list[dict[str, Any]]:
        """All proposals as frames."""
        return [_build_proposal_frame(replan_run) for replan_run in self._items.values()]

    def cancel_replanning(self) -> None:
        """Cancel all planning."""
        for task in self._tasks:
            task.cancel()


def _build_proposal_frame(replan_run: _ProposalRecord) -> dict[str, Any]:
    frame: dict[str, Any] = {
        "kind": "proposal",
        "id": replan_run.id,
        "state": replan_run.state,
        "without": [n + 1 for n in replan_run.remaining.excluded],
        "sentence": replan_run.sentence,
    }
    proposal = replan_run.proposal
    if proposal is not None:
        origin = proposal.plan.saved.origin_m
        frame |= {
            **{key: round(getattr(proposal, key), 1) for key in PROPOSAL_FIGURES},
            "tractors": [
                {
                    "tractor": number + 1,
                    "from_leg": proposal.unchanged_legs[number],
                    "legs": [encode_leg(leg, origin) for leg in timed_mission.legs[proposal.unchanged_legs[number] :]],
                }
                for number, timed_mission in enumerate(proposal.plan.timed_missions)
            ],
        }
    return frame
