"""Proposals of one fleet: what is being worked out, what is ready, what was accepted."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from typing import Any

from planner.errors import HeadlandError
from planner.parameters import word_of
from planner.service.centre.centre import Centre
from planner.service.centre.course import leg_told
from planner.service.centre.errors import CentreError
from planner.service.centre.fleet_plan import FleetPlan
from planner.service.centre.remaining import Rest, rest_of
from planner.service.centre.replanning import Proposal, replanned

Work = Callable[..., Awaitable[Any]]
Show = Callable[[dict[str, Any]], None]
MOST_KEPT = 5


@dataclass(frozen=True)
class _Asked:
    id: int
    state: str
    rest: Rest
    made: Proposal | None = None
    sentence: str | None = None


class Proposals:
    """`work` does a function in a process of its own and can be awaited."""

    def __init__(self, work: Work | None = None) -> None:
        self._work = work
        self._items: dict[int, _Asked] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._last = 0

    def ask(self, centre: Centre, without: list[int], now: float, show: Show) -> int:
        """Have the rest of the work planned; whoever watches is shown it when it is ready. Raises CentreError."""
        if self._work is None:
            raise CentreError("This fleet cannot be planned anew here; drive it through the service.")
        if any(item.state == "planning" for item in self._items.values()):
            raise CentreError("A proposal is being worked out already; wait for it.")
        rest = rest_of(centre, without, now)
        self._last += 1
        asked = _Asked(self._last, "planning", rest)
        self._set(asked, show)
        task = asyncio.get_running_loop().create_task(self._made(self._work, asked, rest, show))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return asked.id

    async def _made(self, work: Work, asked: _Asked, rest: Rest, show: Show) -> None:
        try:
            made: Proposal = await work(replanned, rest)
        except HeadlandError as refusal:
            self._set(replace(asked, state="failed", sentence=refusal.spoken(word_of)), show)
        except Exception as error:
            self._set(replace(asked, state="failed", sentence=f"The planner broke off ({error})."), show)
        else:
            self._set(replace(asked, state="ready", made=made, sentence=made.sentence), show)

    def _set(self, asked: _Asked, show: Show) -> None:
        self._items[asked.id] = asked
        for old in sorted(self._items)[:-MOST_KEPT]:
            del self._items[old]
        show(_told(asked))

    def plan(self, number: int) -> tuple[Rest, FleetPlan]:
        """The plan of a proposal that is ready, and of what it is one. Raises CentreError."""
        asked = self._items.get(number)
        if asked is None or asked.made is None or asked.state != "ready":
            raise CentreError(f"Proposal {number} is not ready; ask for one first.", parameter="proposal")
        return asked.rest, asked.made.plan

    def accepted(self, number: int, show: Show) -> None:
        """It is driven now."""
        self._set(replace(self._items[number], state="accepted"), show)

    def told(self) -> list[dict[str, Any]]:
        """All as frames."""
        return [_told(asked) for asked in self._items.values()]

    def close(self) -> None:
        """Nobody waits any more."""
        for task in self._tasks:
            task.cancel()


def _told(asked: _Asked) -> dict[str, Any]:
    frame: dict[str, Any] = {
        "kind": "proposal", "id": asked.id, "state": asked.state, "without": [n + 1 for n in asked.rest.without],
        "sentence": asked.sentence,
    }  # fmt: skip
    made = asked.made
    if made is not None:
        origin = made.plan.saved.origin_m
        frame |= {
            "eta_s": round(made.eta_s, 1), "moved_m": round(made.moved_m, 1), "left_m": round(made.left_m, 1),
            "blocked_m": round(made.blocked_m, 1),
            "tractors": [
                {"tractor": number + 1, "from_leg": made.kept[number],
                 "legs": [leg_told(leg, origin) for leg in course.legs[made.kept[number] :]]}
                for number, course in enumerate(made.plan.courses)
            ],
        }  # fmt: skip
    return frame
