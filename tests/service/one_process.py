"""The whole service in one app, whose files may be read and whose plans estimated in the process of the tests."""

import asyncio
import json
import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack, chdir
from functools import partial
from typing import Any
from unittest.mock import patch

from fastapi import FastAPI

from planner.service.api import apps
from planner.service.fleets.fleet_sessions import FleetSessions
from planner.service.jobs.file_reading import FileReader
from planner.service.jobs.plan_estimates import PlanEstimator
from planner.service.sandbox import confined_reading, estimating
from planner.service.sandbox.reader_processes import ReadOrder, ReadOutcome
from planner.service.sandbox.readings import READINGS
from planner.service.settings import ServiceSettings
from planner.service.store.service_store import Store
from planner.sweeps.kept_grounds import KeptGrounds

WORKING_FOLDER_LOCK = threading.Lock()  # a process has one working folder


class NoProcesses:
    """Stands for the processes that read, and reads here."""

    def read_order(self, order: ReadOrder) -> ReadOutcome:
        with WORKING_FOLDER_LOCK, chdir(order.folder):  # files have the names of their uploads there
            read = partial(READINGS[order.read], *order.arguments, **order.options)
            return ReadOutcome(confined_reading.encode_answer(read), 0)

    def start_process(self) -> None: ...
    def close(self) -> None: ...


class ReaderHere(FileReader):
    """Reads files in this process."""

    def __init__(self, settings: ServiceSettings, store: Store) -> None:
        super().__init__(settings, store)
        self._processes: Any = NoProcesses()


class EstimatorHere(PlanEstimator):
    """Estimates plans in this process, which charges nobody."""

    def __init__(self, settings: ServiceSettings, store: Store) -> None:
        super().__init__(settings, store)
        for queue in (self._at_once, self._laid_out):
            queue._ask_process = partial(self._estimate_here, KeptGrounds())  # type: ignore[method-assign]

    def _estimate_here(self, grounds: KeptGrounds, order: Mapping[str, Any]) -> dict[str, Any]:
        with WORKING_FOLDER_LOCK, chdir(order["folder"]):
            answer: dict[str, Any] = json.loads(estimating._answer_order(grounds, order))
        return answer | {"computing_s": 0.0}


class SessionsHere(FleetSessions):
    """Fleets whose plans are prepared in this process."""

    async def run_in_process(self, function: Callable[..., Any], *arguments: Any) -> Any:
        return await asyncio.to_thread(function, *arguments)


def create_app(settings: ServiceSettings, *, reads_inline: bool = False) -> FastAPI:
    """Control and office in one app; with `reads_inline` it reads files and makes plans ready in this process."""
    with ExitStack() as stack:
        if reads_inline:
            here = {"FileReader": ReaderHere, "PlanEstimator": EstimatorHere, "FleetSessions": SessionsHere}
            stack.enter_context(patch.multiple(apps, **here))
        app = apps._build_app(settings, apps._run_office, apps._run_control)
        apps._set_up_control_state(app)
        apps._set_up_back_office_state(app)
    app.router.routes.extend(apps._build_routes())
    apps.mount_pages(app)
    apps._add_middleware(app)
    return app
