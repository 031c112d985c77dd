"""All live fleets of a service, their clock, and a process for what takes long."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
import tempfile
import time
import tomllib
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from planner.errors import HeadlandError, WorkerError
from planner.parameters import word_of
from planner.pool import LocalPool
from planner.service.centre.chances import Chances
from planner.service.centre.fleet_plan import FleetPlan, prepared
from planner.service.centre.orders import Event
from planner.service.centre.progress import restore
from planner.service.centre.rules import Rules
from planner.service.errors import BusyError, MissingError
from planner.service.links.converting import next_shown
from planner.service.links.live import LiveFleet
from planner.service.links.proposals import Proposals
from planner.service.links.recording import keep, rising
from planner.service.links.warming import warm
from planner.service.store import Store
from vehicle.tractor import Tractor

STEP_S, KEEP_S, LOOK_S, TOKENS_S = 0.05, 1.0, 1.0, 1.0
REVOKED = "The token of this link was revoked; link again with another one."
DELETED = "This fleet was deleted."
MOST_FLEETS = 20
TRIES = 2
X, Y, WORKS = 2, 3, 10  # columns of kept rows
Files = Mapping[str, tuple[str, bytes]]
"""Contents by parameter (field, tractor), each with the ending of its file."""
Look = Callable[[LiveFleet, float], Awaitable[None]]


def prepared_with(text: str, files: Files, timing: Mapping[str, Any] | None = None) -> FleetPlan:
    """`prepared` with files that are handed in as bytes."""
    with tempfile.TemporaryDirectory() as folder:
        paths = {}
        for parameter, (suffix, content) in files.items():
            paths[parameter] = Path(folder) / f"{parameter}{suffix}"
            paths[parameter].write_bytes(content)
        return prepared(text, **paths, timing=timing)


class Hub:
    """Live fleets by id. `faults` has why a stored fleet could not be taken up again.

    `look` is called for each about once a second and may wait.
    """

    def __init__(self, store: Store, look: Look | None = None) -> None:
        self.store, self._look = store, look
        self.fleets: dict[str, LiveFleet] = {}
        self.faults: dict[str, str] = {}
        self._pool: LocalPool | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._keeping, self._ordered = asyncio.Lock(), asyncio.Event()

    async def start(self) -> None:
        """Take up stored fleets, before anybody asks for them, and let time pass.

        Before that all that is compiled on first use is loaded, as nobody's frames are to wait for it later.
        """
        await asyncio.to_thread(warm)
        await self.take_up()
        loops = (self._run(), self._keep_on(), self._look_on(), self._watch_tokens())
        self._tasks = [asyncio.create_task(each) for each in loops]

    async def stop(self) -> None:
        """Keep what there is and end."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for fleet in list(self.fleets.values()):
            fleet.proposals.close()
            await self.keep(fleet)
        if self._pool is not None:
            await asyncio.to_thread(self._pool.shutdown, wait=True, cancel_futures=True)

    async def work(self, fn: Callable[..., Any], *arguments: Any) -> Any:
        """Do something in a process of its own, so that nobody's frames wait for it.

        Where that process is killed another one does it again. Raises WorkerError when that is killed too.
        """
        for _ in range(TRIES):
            pool = self._pool = self._pool or LocalPool(1)
            try:
                return await asyncio.wrap_future(pool.submit(fn, *arguments))
            except BrokenProcessPool:
                self._pool = None if self._pool is pool else self._pool
                pool.shutdown(wait=False)
        raise WorkerError("The process that was to work this out was ended from outside; see what is short on this "
                          "machine, memory most likely, and ask again.")  # fmt: skip

    def fleet(self, id: str) -> LiveFleet:
        """A fleet that runs; raises MissingError."""
        if id not in self.fleets:
            raise MissingError(f"There is no live fleet {id[:40]!r}; the list shows all.", parameter="id")
        return self.fleets[id]

    async def create(self, name: str, text: str, files: Files, settings: dict[str, Any]) -> LiveFleet:
        """A new fleet, ready to start; its deadline is by default that of its plan.

        Raises BusyError for one too many, a HeadlandError for what cannot be driven.
        """
        if len(self.fleets) >= MOST_FLEETS:
            raise BusyError(f"There are {len(self.fleets)} live fleets, as many as are taken; delete one first.")
        plan = await self.work(prepared_with, text, files)
        settings = settings | {"begin_s": time.time()}
        before_s = plan.scenario.before_s
        if settings.get("deadline_s") is None and before_s is not None:
            settings["deadline_s"] = next_shown(before_s)
        fleet = self._live(secrets.token_hex(8), name, plan, settings)
        await asyncio.to_thread(self.store.save_fleet, fleet.id, name, text, settings)
        self.add(fleet)
        return fleet

    def add(self, fleet: LiveFleet) -> None:
        """Take a fleet that somebody has made."""
        fleet.on_order = self._ordered.set
        self.fleets[fleet.id] = fleet

    def _live(self, id: str, name: str, plan: FleetPlan, settings: Mapping[str, Any]) -> LiveFleet:
        rules, chances = Rules(times=settings["times"]), settings.get("chances")
        return LiveFleet(
            id, name, plan, rules, begin_s=settings["begin_s"], way=settings["way"],
            deadline_s=settings.get("deadline_s"), chances=None if chances is None else Chances(**chances),
            propose=Proposals(self.work),
        )  # fmt: skip

    async def delete(self, id: str) -> None:
        """End a fleet, whose tractors are told to stand, and forget it; raises MissingError."""
        fleet = self.fleets.pop(id, None)
        if fleet is not None:
            fleet.close(DELETED, time.monotonic())
        self.faults.pop(id, None)
        await asyncio.to_thread(self.store.delete_fleet, id)

    async def take_up(self) -> None:
        """Go on with the fleets of the store."""
        for row in await asyncio.to_thread(self.store.fleets):
            if row.id in self.fleets:
                continue
            try:
                files = {name: tuple(given) for name, given in row.settings.get("files", {}).items()}
                contents = {
                    name: (suffix, await asyncio.to_thread(self.store.blobs.get, sha256))
                    for name, (suffix, sha256) in files.items()
                }
                kept = row.progress
                plan = await self.work(prepared_with, kept.get("plan") or row.plan, contents, kept.get("timing"))
                fleet = self._live(row.id, row.name, plan, row.settings)
                restore(fleet.centre, kept.get("centre", {}), time.monotonic(), time.time())
                fleet.plan_text = kept.get("plan")
                await asyncio.to_thread(self._mended_again, fleet, kept.get("mended", {}))
                await self._repaint(fleet, row.progress)
                self.add(fleet)
            except HeadlandError as refusal:
                self.faults[row.id] = refusal.spoken(word_of)
                logging.getLogger(__name__).warning("Fleet %s is not taken up again: %s", row.id, refusal)
            except Exception:
                self.faults[row.id] = "What is kept of this fleet cannot be read; make it anew of its plan."
                logging.getLogger(__name__).exception("Fleet %s is not taken up again", row.id)

    def _mended_again(self, fleet: LiveFleet, mended: Mapping[str, str]) -> None:
        """Twins get the tractor files that they were mended by; where one was deleted meanwhile, the plan's."""
        for number, name in mended.items():
            with contextlib.suppress(MissingError):
                content = self.store.blobs.get(self.store.file("tractor", name).sha256)
                fleet.twins.mended(int(number), Tractor(**tomllib.loads(content.decode())))
                fleet.mended[int(number)] = name

    async def _repaint(self, fleet: LiveFleet, progress: Mapping[str, Any]) -> None:
        """Sequences and painted ground from what was recorded."""
        for number in range(fleet.tractor_count):
            rows = rising(await asyncio.to_thread(self.store.recording, fleet.id, number))
            east, north = fleet.centre.plan.saved.origin_m
            for row in rows:
                fleet.centre.painting.at(number, row[X] - east, row[Y] - north, bool(row[WORKS]))
            if rows:
                fleet.recorder.seen[number] = fleet.recorder.kept[number] = rows[-1][0]

    async def _run(self) -> None:
        """Every fleet takes a step twenty times a second, whatever becomes of one of them."""
        due = time.monotonic()
        while True:
            for fleet in list(self.fleets.values()):
                try:
                    fleet.step(time.monotonic())
                except Exception:
                    logging.getLogger(__name__).exception("Fleet %s", fleet.id)
            due = max(due + STEP_S, time.monotonic() - STEP_S)
            await asyncio.sleep(max(0.0, due - time.monotonic()))

    async def _keep_on(self) -> None:
        """Keep all once a second, and at once what somebody orders: a stop must outlive a service that is killed."""
        while True:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._ordered.wait(), KEEP_S)
            self._ordered.clear()
            for fleet in list(self.fleets.values()):
                try:
                    await self.keep(fleet)
                except Exception:
                    logging.getLogger(__name__).exception("Keeping fleet %s", fleet.id)

    async def _look_on(self) -> None:
        while self._look is not None:
            await asyncio.sleep(LOOK_S)
            for fleet in list(self.fleets.values()):
                try:
                    await self._look(fleet, time.monotonic())
                except Exception:
                    logging.getLogger(__name__).exception("Looking at fleet %s", fleet.id)

    async def _watch_tokens(self) -> None:
        while True:
            await asyncio.sleep(TOKENS_S)
            try:
                await self.check_tokens()
            except Exception:
                logging.getLogger(__name__).exception("Looking for revoked tokens")

    async def check_tokens(self) -> None:
        """Turn out all whose tokens were revoked since they were linked."""
        holders = [(fleet, client) for fleet in self.fleets.values() for client in fleet.clients if client.token]
        if not holders:
            return
        known = {token.sha256 for token in await asyncio.to_thread(self.store.tokens)}
        for fleet, client in holders:
            if client.token not in known:
                client.turn_out(REVOKED)
                fleet.leave(client, time.monotonic())

    async def keep(self, fleet: LiveFleet) -> None:
        """Write what was reported and what happened, then acknowledge it.

        A write that has begun is ended also when who asked for it is cancelled, so that nothing is written twice.
        """
        await asyncio.shield(self._keep(fleet))

    async def _keep(self, fleet: LiveFleet) -> None:
        async with self._keeping:
            taken, events = fleet.recorder.take(), fleet.events
            fleet.events = []
            progress = fleet.progress(time.monotonic(), time.time())
            try:
                await asyncio.to_thread(_write, self.store, fleet.id, taken, events, progress)
            except Exception:
                fleet.recorder.back(taken)
                fleet.events = events + fleet.events
                raise
            fleet.acknowledge(taken)


def _write(store: Store, id: str, taken: Any, events: list[tuple[str, Event]], progress: dict[str, Any]) -> None:
    keep(store, id, taken)
    while events:  # what is left of them after a fault is written next time
        store.add_event(id, events[0][1].who, events[0][1].what, events[0][1].data)
        del events[0]
    store.save_progress(id, progress)
