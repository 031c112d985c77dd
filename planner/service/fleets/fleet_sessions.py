"""All live fleets of a service, their clock, saving, and a process for long computations."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
import tempfile
import time
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from planner.errors import HeadlandError, WorkerError, render_refusal
from planner.fleet.manager.finish_forecast import FinishDistribution
from planner.fleet.manager.neighbourhood import Neighbourhood
from planner.fleet.manager.progress_snapshot import restore_progress
from planner.fleet.model.fleet_plan import FleetPlan, prepare_fleet_plan
from planner.fleet.model.rules import REFRESH_PERIOD_S, FleetRules
from planner.fleet.model.tractor_state import FleetEvent
from planner.fleet.replanning.proposals import ReplanProposals
from planner.fleet.session.clients import CONTROL, TRACTOR, FleetClient
from planner.fleet.session.fleet_session import MOST_EVENTS, FleetSession
from planner.fleet.session.fleet_twins import warm_up
from planner.fleet.session.state_recorder import ROW_COLUMNS, select_rising_rows
from planner.pipeline.executors import KILLED_WORKER_MESSAGE, LocalPool
from planner.service.errors import BusyError, NotFoundError
from planner.service.fleets.video_addresses import VideoHosts, read_stored_addresses
from planner.service.gateway.responses import require_state
from planner.service.settings import LIMITS
from planner.service.store.database_watch import TokenCache
from planner.service.store.service_store import Store
from vehicle.model.tractor import parse_tractor

STEP_S, SAVE_PERIOD_S = 0.05, REFRESH_PERIOD_S
DELETED_TEXT = "This fleet was deleted."
EASTING_COLUMN, NORTHING_COLUMN, IMPLEMENT_COLUMN = map(ROW_COLUMNS.index, ("easting_m", "northing_m", "implement"))
Files = Mapping[str, tuple[str, bytes]]
"""Contents by parameter (field, tractor), each with its file suffix."""
FollowUp = Callable[[FleetSession, float], Awaitable[None]]


def prepare_with_files(text: str, files: Files, timing: Mapping[str, Any] | None = None) -> FleetPlan:
    """prepare_fleet_plan with files given as bytes."""
    with tempfile.TemporaryDirectory() as folder:
        paths = {}
        for parameter, (suffix, content) in files.items():
            paths[parameter] = Path(folder) / f"{parameter}{suffix}"
            paths[parameter].write_bytes(content)
        return prepare_fleet_plan(text, **paths, timing=timing)


@dataclass
class FleetLabel:
    """Name of a fleet, when it was created (UTC), the length of its plan as text, and addresses of video by tractor.

    `fault` says why a stored one could not be restored, None for a live one.
    """

    id: str
    name: str
    created: str
    plan_bytes: int = 0
    fault: str | None = None
    videos: dict[int, str] = field(default_factory=dict)


NewFleet = tuple[FleetLabel, FleetPlan, dict[str, Any]]
"""Label, plan and settings of a fleet that was stored and has no session yet."""


class FleetSessions:
    """Live fleets by id; `labels` names those that could not be restored too.

    `follow_up` is called for each about once a second and may wait. One thread only writes to the database, so that
    neither orders nor frames wait for it.
    """

    def __init__(self, store: Store, follow_up: FollowUp | None = None, book: TokenCache | None = None) -> None:
        self.store, self._follow_up = store, follow_up
        self.book = TokenCache(store) if book is None else book
        self.by_id: dict[str, FleetSession] = {}
        self.neighbourhood = Neighbourhood()
        self.labels: dict[str, FleetLabel] = {}
        self.video_hosts = VideoHosts(store.settings.video_hosts)
        self.on_stop: Callable[[float], None] | None = None
        self.lag_s = 0.0  # delay of the last step of the fleets, itself included
        self._pool: LocalPool | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._saving, self._order_given = asyncio.Lock(), asyncio.Event()
        self._writer = ThreadPoolExecutor(1, thread_name_prefix="saving")
        self._unsaved: set[str] = set()
        self._creating = asyncio.Lock()

    async def start(self) -> None:
        """Compile what is needed, restore stored fleets, and start the clock."""
        await asyncio.to_thread(self.book.start)
        await asyncio.to_thread(warm_up)
        await self.restore_sessions()
        loops = [self._step_sessions_forever(), self._save_periodically(), self._watch_tokens()]
        if self._follow_up is not None:
            loops.append(self._follow_up_diagnoses_periodically(self._follow_up))
        self._tasks = [asyncio.create_task(loop) for loop in loops]

    async def stop(self) -> None:
        """Save all fleets and stop."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for session in self.by_id.values():
            session.proposals.cancel_replanning()
        with contextlib.suppress(Exception):  # an unreachable database must not prevent stopping
            async with asyncio.timeout(LIMITS.end_timeout_s):
                for session in list(self.by_id.values()):
                    await self.save(session)
        self._writer.shutdown(wait=False, cancel_futures=True)
        await asyncio.to_thread(self.book.close)
        if self._pool is not None:
            await asyncio.to_thread(self._pool.shutdown, wait=True, cancel_futures=True)

    async def run_in_process(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Run a function in a process of its own, so that no frames wait for it.

        If that process is killed, another one tries again. Raises WorkerError if that is killed too.
        """
        for _ in range(LIMITS.work_attempts):
            pool = self._pool = self._pool or LocalPool(1)
            try:
                return await asyncio.wrap_future(pool.submit(function, *arguments))
            except BrokenProcessPool:
                self._pool = None if self._pool is pool else self._pool
                pool.shutdown(wait=False)
        raise WorkerError(KILLED_WORKER_MESSAGE)

    def get_label(self, id: str) -> FleetLabel:
        """The label of a fleet, also of one that could not be restored; raises NotFoundError."""
        if id not in self.labels:
            raise NotFoundError(f"There is no fleet {id[:60]!r}; see the list of fleets.", parameter="id")
        return self.labels[id]

    def list_video_origins(self) -> list[str]:
        """Scheme, host and port of every allowed video of a fleet that names a host."""
        return self.video_hosts.list_origins(one for label in self.labels.values() for one in label.videos.values())

    def get_session(self, id: str) -> FleetSession:
        """A live fleet; raises NotFoundError."""
        if id not in self.by_id:
            raise NotFoundError(f"There is no live fleet {id[:40]!r}; see the list of fleets.", parameter="id")
        return self.by_id[id]

    async def create_session(self, build: Callable[..., NewFleet], *arguments: Any) -> FleetSession:
        """Create a fleet, ready to start; one after the other, so that few plans are in memory.

        `build` does so in a process of its own, of an id, the bytes that a plan may have, and the arguments. Raises
        BusyError for too many fleets, and what `build` raises.
        """
        async with self._creating:
            if len(self.by_id) >= LIMITS.most_fleets:
                raise BusyError(f"There are {len(self.by_id)} live fleets, the most allowed; delete one first.")
            # Prepared plans take about as much memory as their texts: together no more than one upload.
            room_bytes = self.store.settings.upload_bytes - sum(label.plan_bytes for label in self.labels.values())
            label, plan, settings = await self.run_in_process(build, secrets.token_hex(8), room_bytes, *arguments)
            session, self.labels[label.id] = self._build_session(label, plan, settings), label
            self.add(session)
        return session

    def check_capacity(self, client: FleetClient) -> None:
        """Raise BusyError for too many links of a token, or in all; tractors are always let in."""
        if client.role == TRACTOR:
            return
        clients = [each for session in self.by_id.values() for each in session.clients]
        other_clients = [each for each in clients if each.role != TRACTOR]
        own_count = sum(each.token == client.token for each in other_clients)
        if own_count >= LIMITS.most_links_per_token:
            whose = "this token" if client.token else "logged-in browsers"
            raise BusyError(f"{own_count} links of {whose} are open, the most allowed; close one first.")
        if len(other_clients) >= LIMITS.most_links and client.role != CONTROL:
            raise BusyError(f"{len(other_clients)} viewing links are open, the most allowed; close one first.")

    def add(self, session: FleetSession) -> None:
        """Add a fleet session."""
        self.labels.setdefault(session.id, FleetLabel(session.id, session.name, ""))
        session.on_order, session.on_stop = self._order_given.set, self.on_stop
        self.by_id[session.id] = session
        self.neighbourhood.add(
            session.id, session.name, session.manager, session.send_pending_outputs, time.monotonic()
        )

    def _build_session(self, label: FleetLabel, plan: FleetPlan, settings: Mapping[str, Any]) -> FleetSession:
        # Fleets of earlier versions have no horizon.
        given_rules = {name: settings[name] for name in ("times", "horizon_s") if name in settings}
        chances = settings.get("chances")
        return FleetSession(
            label.id, label.name, plan, FleetRules(**given_rules), begin_s=settings["begin_s"],
            twin_method=settings["way"], deadline_s=settings.get("deadline_s"),
            proposals=ReplanProposals(self.run_in_process),
            finish_distribution=None if chances is None else FinishDistribution(**chances),
        )  # fmt: skip

    async def delete(self, id: str) -> None:
        """Stop a fleet and delete it; raises NotFoundError."""
        session = self.by_id.pop(id, None)
        if session is not None:
            session.close(DELETED_TEXT, time.monotonic())
            self.neighbourhood.remove(id, time.monotonic())
        self.labels.pop(id, None)
        await asyncio.to_thread(self.store.delete_fleet, id)

    async def restore_sessions(self) -> None:
        """Restore the fleets of the store."""
        for row in await asyncio.to_thread(self.store.list_fleets):
            if row.id in self.by_id:
                continue
            label = self.labels[row.id] = FleetLabel(row.id, row.name, row.created)
            label.videos = read_stored_addresses(row.settings)
            try:
                contents = {
                    name: (suffix, await asyncio.to_thread(self.store.blobs.read_bytes, sha256))
                    for name, (suffix, sha256) in row.settings.get("files", {}).items()
                }
                saved = row.progress
                text = saved.get("plan") or row.plan
                plan = await self.run_in_process(prepare_with_files, text, contents, saved.get("timing"))
                session = self._build_session(label, plan, row.settings)
                restore_progress(session.manager, saved.get("centre", {}), time.monotonic(), time.time())
                session.plan_text = saved.get("plan")
                label.plan_bytes = len(text.encode())
                await asyncio.to_thread(self._restore_twin_files, session, saved.get("mended", {}))
                await self._restore_coverage(session)
                self.add(session)
            except HeadlandError as refusal:
                label.fault = render_refusal(refusal)
                logging.getLogger(__name__).warning("Fleet %s is not restored: %s", row.id, refusal)
            except Exception:
                label.fault = "The saved state of this fleet cannot be read; create it again from its plan."
                logging.getLogger(__name__).exception("Fleet %s is not restored", row.id)

    def _restore_twin_files(self, session: FleetSession, twin_files: Mapping[str, str]) -> None:
        """Give twins their extended tractor files; if one was deleted, the plan's tractor."""
        for number, name in twin_files.items():
            with contextlib.suppress(NotFoundError):
                content = self.store.blobs.read_bytes(self.store.get_file("tractor", name).sha256)
                session.twins.change_tractor(int(number), parse_tractor(content.decode(), name))
                session.twin_files[int(number)] = name

    async def _restore_coverage(self, session: FleetSession) -> None:
        """Restore sequences and coverage from the recording."""
        for number in range(session.tractor_count):
            rows = select_rising_rows(await asyncio.to_thread(self.store.read_recording, session.id, number))
            east, north = session.manager.plan.saved.origin_m
            for row in rows:
                session.manager.add_coverage(
                    number, row[EASTING_COLUMN] - east, row[NORTHING_COLUMN] - north, bool(row[IMPLEMENT_COLUMN])
                )
            if rows:
                session.recorder.received[number] = session.recorder.saved[number] = rows[-1][0]

    async def _step_sessions_forever(self) -> None:
        """Step every fleet twenty times a second; a fault in one does not stop the others."""
        due = time.monotonic()
        while True:
            for session in list(self.by_id.values()):
                try:
                    session.step(time.monotonic())
                    session.check_saving(time.monotonic(), time.time())
                except Exception:
                    logging.getLogger(__name__).exception("Fleet %s", session.id)
            self.lag_s = max(0.0, time.monotonic() - due)
            due = max(due + STEP_S, time.monotonic() - STEP_S)
            await asyncio.sleep(max(0.0, due - time.monotonic()))

    async def _save_periodically(self) -> None:
        """Save all fleets once a second, and at once after an order: a stop must survive a killed service."""
        while True:
            # Up to Python 3.11 wait_for drops a cancellation that comes with the order, so that nothing would end this.
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(SAVE_PERIOD_S):
                    await self._order_given.wait()
            self._order_given.clear()
            for session in list(self.by_id.values()):
                try:
                    await self.save(session)
                    self._unsaved.discard(session.id)
                except Exception:  # unsaved rows wait unacknowledged; logged once
                    if session.id in self.by_id and session.id not in self._unsaved:
                        self._unsaved.add(session.id)
                        logging.getLogger(__name__).exception("Saving fleet %s", session.id)

    async def _follow_up_diagnoses_periodically(self, follow_up: FollowUp) -> None:
        while True:
            await asyncio.sleep(REFRESH_PERIOD_S)
            for session in list(self.by_id.values()):
                try:
                    await follow_up(session, time.monotonic())
                except Exception:
                    logging.getLogger(__name__).exception("Following up fleet %s", session.id)

    async def _watch_tokens(self) -> None:
        while True:
            await asyncio.sleep(REFRESH_PERIOD_S)
            try:
                await self.check_tokens()
            except Exception:
                logging.getLogger(__name__).exception("Checking tokens")

    async def check_tokens(self) -> None:
        """Expel clients whose tokens were revoked or have expired."""
        holders = [(session, client) for session in self.by_id.values() for client in session.clients if client.token]
        if not holders:
            return
        refused = self.book.find_invalid_tokens({str(client.token) for _, client in holders})
        for session, client in holders:
            if client.token in refused:
                client.expel(refused[client.token])
                session.remove_client(client, time.monotonic())

    async def save(self, session: FleetSession) -> None:
        """Write states, events and progress, then acknowledge the states.

        A write in progress is completed even if the caller is cancelled, so that nothing is written twice.
        """
        await asyncio.shield(self._write_session_state(session))

    async def _write_session_state(self, session: FleetSession) -> None:
        async with self._saving:
            progress = session.capture_progress(time.monotonic(), time.time())
            taken, events = session.recorder.take_waiting_rows(), session.events
            session.events = []
            try:
                write = partial(_write_progress, self.store, session.id, taken, events, progress)
                await asyncio.get_running_loop().run_in_executor(self._writer, write)
            except Exception:
                session.recorder.put_back(taken)
                session.events = (events + session.events)[-MOST_EVENTS:]
                raise
            session.acknowledge_states(taken)
            session.mark_saved(time.monotonic())


SessionsAccess = Annotated[FleetSessions, require_state("hub")]
"""The live fleets, for routes."""


def _write_progress(
    store: Store, id: str, taken: Any, events: list[tuple[str, FleetEvent]], progress: dict[str, Any]
) -> None:
    for number, rows in taken:
        store.add_recording(id, number, rows)
    while events:  # after a fault the rest is written next time
        store.add_event(id, events[0][1].who, events[0][1].what, events[0][1].data)
        del events[0]
    store.save_progress(id, progress)
