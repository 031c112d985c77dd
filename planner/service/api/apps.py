"""The apps: the control process, and the back office behind it.

control   rights and limits, fleets, links and stops; it forwards everything else to the office
office    files, summaries, jobs, exports, tokens, events, documentation and pages
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import signal
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager
from functools import cache, partial
from importlib import resources
from multiprocessing.connection import Connection

import uvicorn
from fastapi import APIRouter, Depends, FastAPI, HTTPException, Response
from prometheus_client import ProcessCollector
from sqlalchemy.exc import DBAPIError
from starlette.routing import BaseRoute

from planner.service.access.browsers import LOGIN_PATH, BrowserLogins, OneTimeViews, SecurityHeadersMiddleware
from planner.service.api import administration
from planner.service.api.administration import ServiceMetrics, measure_connections, measure_fleets, measure_store
from planner.service.api.job_routes import (
    JOB_KIND_BY_PATH,
    all_jobs_router,
    build_jobs_router,
    form_router,
    plans_router,
)
from planner.service.api.uploads import build_files_router
from planner.service.backgrounds.map_background import MapBackground, background_router
from planner.service.fleets import fleet_routes
from planner.service.fleets.fleet_sessions import FleetSessions
from planner.service.fleets.fleet_socket import PENDING_LIMITS, link_router
from planner.service.fleets.twin_routes import TwinDiagnosis, twin_router
from planner.service.fleets.video_addresses import video_router
from planner.service.gateway.back_office import LOOPBACK_HOST, BackOffice, OfficeForwarder, SharedSecretMiddleware
from planner.service.gateway.connection_limits import ConnectionRegistry
from planner.service.gateway.request_gate import (
    BODIES_FOLDER,
    BodyBudget,
    RequestGate,
    list_route_rules,
    refuse_unknown_query,
)
from planner.service.gateway.request_logs import RequestIdMiddleware, set_up_logs
from planner.service.gateway.responses import add_error_handlers
from planner.service.jobs.file_reading import FileReader
from planner.service.jobs.plan_estimates import PlanEstimator
from planner.service.jobs.workers import WorkerSupervisor
from planner.service.kept_process import end_with_service
from planner.service.pages.static_files import mount_pages
from planner.service.sandbox.confinement import lower_priority
from planner.service.settings import LIMITS, ServiceSettings, find_version
from planner.service.store.backup import sweep_unnamed_bytes
from planner.service.store.database_watch import DatabaseWatch, TokenCache
from planner.service.store.service_store import SUFFIXES_BY_KIND, Store

DOCS_ASSETS = {
    "swagger-ui-bundle.js": "text/javascript; charset=utf-8",
    "swagger-ui.css": "text/css; charset=utf-8",
    "favicon-32x32.png": "image/png",
}
DOCS_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>Headland: the service</title>
<link rel="icon" href="docs/favicon-32x32.png"><link rel="stylesheet" href="docs/swagger-ui.css"></head>
<body><div id="docs"></div><script src="docs/swagger-ui-bundle.js"></script><script src="docs/start.js"></script></body>
</html>
"""
DOCS_SCRIPT = (
    'SwaggerUIBundle({url: "openapi.json", dom_id: "#docs", deepLinking: true, persistAuthorization: false});\n'
)

docs_router = APIRouter(include_in_schema=False)
API_PREFIX = "/api/v1"
TOKENS_PATH = f"{API_PREFIX}/tokens"
ABANDONED_PATHS = frozenset({f"{API_PREFIX}/estimates"})
API_DESCRIPTION = (
    "Plan, watch and drive fleets. Lists are {items: [...]}, refusals {error: sentence, parameter: name or null}."
)
AppPart = Callable[[FastAPI], AbstractAsyncContextManager[None]]


@docs_router.get("/docs")
def show_docs_page() -> Response:
    """The documentation page, which works offline."""
    return Response(DOCS_PAGE, media_type="text/html; charset=utf-8")


@docs_router.get("/docs/start.js")
def show_docs_script() -> Response:
    """The script of the documentation page."""
    return Response(DOCS_SCRIPT, media_type="text/javascript; charset=utf-8")


@docs_router.get("/docs/{name}")
def show_docs_asset(name: str) -> Response:
    """A file of the documentation page."""
    if name not in DOCS_ASSETS:
        raise HTTPException(404)
    content = (resources.files("fastapi_swagger.resources") / name).read_bytes()
    return Response(content, media_type=DOCS_ASSETS[name], headers={"cache-control": "max-age=86400"})


def create_control_app(settings: ServiceSettings, office: BackOffice, connections: ConnectionRegistry) -> FastAPI:
    """The app of the control process. Raises DatabaseError."""
    app = _build_app(settings, _run_forwarding, _run_control, openapi_url=None)
    _set_up_control_state(app)
    app.state.office = office
    app.state.metrics.add_measured(measure_connections, connections)
    ProcessCollector("headland_office", lambda: office.pid, registry=app.state.metrics.registry)
    app.router.routes.extend(_build_routes(has_office=False))

    async def refresh_tokens(path: str) -> None:
        if path.startswith(TOKENS_PATH):
            await asyncio.to_thread(app.state.book.refresh)

    flush_recordings = partial(fleet_routes.save_recording_before_read, app.state.hub)
    forward = app.state.forward = OfficeForwarder(office, flush_recordings, refresh_tokens, ABANDONED_PATHS)
    app.router.default = forward
    _add_middleware(app)
    return app


def create_back_office_app(settings: ServiceSettings, secret: str) -> FastAPI:
    """The app of the office, which answers only requests with the secret. Raises DatabaseError."""
    app = _build_app(settings, _run_readers, _run_office)
    app.state.reader = FileReader(settings, app.state.store)
    _set_up_back_office_state(app)
    app.router.routes.extend(_build_routes(has_control=False))
    # The routes of the control process, which answers them itself, are documented too.
    documented = FastAPI(title=app.title, version=app.version, description=app.description)
    documented.router.routes.extend(_build_routes())
    app.openapi = documented.openapi  # type: ignore[method-assign]
    mount_pages(app)
    app.add_middleware(SharedSecretMiddleware, secret=secret)
    app.add_middleware(RequestIdMiddleware, trusts_header=True)
    return app


def list_control_routers() -> list[APIRouter]:
    """Routers that need the memory of the control process."""
    return [
        administration.health_router, administration.revocation_router, fleet_routes.fleet_router, video_router,
        twin_router, link_router,
    ]  # fmt: skip


@cache
def list_back_office_routers() -> tuple[APIRouter, ...]:
    """All other routers; those of each kind of file and of job belong to no app and are made once, as those of modules
    are."""
    return (
        *map(build_files_router, SUFFIXES_BY_KIND), *map(build_jobs_router, JOB_KIND_BY_PATH), plans_router,
        form_router, all_jobs_router, background_router, fleet_routes.recording_router, administration.tokens_router,
        administration.events_router, docs_router,
    )  # fmt: skip


def _build_app(
    settings: ServiceSettings, *parts: AppPart, openapi_url: str | None = f"{API_PREFIX}/openapi.json"
) -> FastAPI:
    """An app whose parts run, the first one around the others, from its start to its end."""

    @contextlib.asynccontextmanager
    async def run_parts(app: FastAPI) -> AsyncIterator[None]:
        async with contextlib.AsyncExitStack() as stack:
            stack.callback(app.state.store.close)
            for part in parts:
                await stack.enter_async_context(part(app))
            yield

    app = FastAPI(
        title="Headland", version=find_version(), description=API_DESCRIPTION, lifespan=run_parts,
        openapi_url=openapi_url, docs_url=None, redoc_url=None, swagger_ui_oauth2_redirect_url=None,
    )  # fmt: skip
    app.state.settings = settings
    app.state.store = Store(settings)
    app.state.office = None
    add_error_handlers(app)
    return app


def _set_up_control_state(app: FastAPI) -> None:
    state = app.state
    state.book, state.watch = TokenCache(state.store), DatabaseWatch(state.store)
    state.logins = BrowserLogins(secure=state.settings.public_url.startswith("https://"))
    state.reader = FileReader(state.settings, state.store)
    state.diagnosing = TwinDiagnosis(state.store, state.reader)
    state.hub = FleetSessions(state.store, state.diagnosing.follow_up, book=state.book)
    state.bodies = BodyBudget(state.settings)
    shutil.rmtree(state.settings.data / BODIES_FOLDER, ignore_errors=True)  # those of a service that was killed
    state.greetings = ConnectionRegistry(PENDING_LIMITS)
    state.metrics = ServiceMetrics()
    state.metrics.add_measured(measure_fleets, state.hub)
    state.metrics.add_measured(measure_store, state.store, state.watch, state.bodies)
    state.hub.on_stop = partial(state.metrics.count_stop, "link")
    app.add_route(LOGIN_PATH, administration.log_in_browser, methods=["GET"], include_in_schema=False)
    app.add_route("/metrics", administration.show_metrics, methods=["GET"], include_in_schema=False)


def _set_up_back_office_state(app: FastAPI) -> None:
    app.state.estimator = PlanEstimator(app.state.settings, app.state.store)
    app.state.supervisor = WorkerSupervisor(app.state.settings, app.state.store)
    app.state.views = OneTimeViews()
    app.state.background = MapBackground(app.state.settings)


@cache
def _build_routes(*, has_control: bool = True, has_office: bool = True) -> tuple[BaseRoute, ...]:
    """Routes below /api/v1, with their models of parameters and answers: made once, as that takes half a second, and
    shared by all apps of a process."""
    control, office = list_control_routers() if has_control else [], list_back_office_routers() if has_office else ()
    dependencies = [Depends(refuse_unknown_query)]
    combined = APIRouter(prefix=API_PREFIX, dependencies=dependencies)
    for router in (*control, *office):
        combined.include_router(router)
    whole = APIRouter()
    whole.include_router(combined)
    return tuple(whole.routes)


def _add_middleware(app: FastAPI) -> None:
    """Add the gate before all routes, with those of the office."""
    settings: ServiceSettings = app.state.settings
    rules = list_route_rules(list_control_routers(), API_PREFIX, settings, are_orders=True)
    rules += list_route_rules(list_back_office_routers(), API_PREFIX, settings)
    app.add_middleware(RequestGate, settings=settings, rules=rules, bodies=app.state.bodies)
    app.add_middleware(SecurityHeadersMiddleware, list_video_origins=app.state.hub.list_video_origins)
    app.add_middleware(RequestIdMiddleware, observe=app.state.metrics.observe_request)


@contextlib.asynccontextmanager
async def _run_forwarding(app: FastAPI) -> AsyncIterator[None]:
    app.state.office.kept_process.start()
    try:
        yield
    finally:
        await app.state.forward.close()
        await app.state.office.stop()


@contextlib.asynccontextmanager
async def _run_readers(app: FastAPI) -> AsyncIterator[None]:
    app.state.reader.start_processes()
    try:
        yield
    finally:
        app.state.reader.close()


@contextlib.asynccontextmanager
async def _run_control(app: FastAPI) -> AsyncIterator[None]:
    try:
        await asyncio.to_thread(app.state.watch.start)
        await app.state.hub.start()
        yield
    finally:
        await app.state.hub.stop()
        await asyncio.to_thread(app.state.watch.close)
        app.state.reader.close()


@contextlib.asynccontextmanager
async def _run_office(app: FastAPI) -> AsyncIterator[None]:
    sweep_task: asyncio.Task[None] | None = None
    try:
        await asyncio.to_thread(sweep_unnamed_bytes, app.state.store)
        await asyncio.to_thread(app.state.store.lend_all_inputs)
        sweep_task = asyncio.create_task(_sweep_forever(app.state.store))
        app.state.supervisor.start()
        yield
    finally:
        if sweep_task is not None:
            sweep_task.cancel()
        await app.state.background.close()
        await asyncio.to_thread(app.state.estimator.close)
        await asyncio.to_thread(app.state.supervisor.stop)


async def _sweep_forever(store: Store) -> None:
    """Delete the bytes of refused uploads and deleted files from time to time."""
    while True:
        await asyncio.sleep(LIMITS.sweep_period_s)
        with contextlib.suppress(DBAPIError):
            await asyncio.to_thread(sweep_unnamed_bytes, store)


def run_back_office(settings: ServiceSettings, secret: str, port_sender: Connection) -> None:
    """Run the office until the service ends; the main function of its process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.umask(0o077)
    lower_priority()
    set_up_logs()
    end_with_service()
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.bind((LOOPBACK_HOST, 0))
    listener.listen(LIMITS.backlog)
    config = uvicorn.Config(
        create_back_office_app(settings, secret), log_config=None, access_log=False, proxy_headers=False,
        server_header=False, ws="none", timeout_graceful_shutdown=2, timeout_keep_alive=60, backlog=LIMITS.backlog,
    )  # fmt: skip

    class PortReportingServer(uvicorn.Server):
        """Reports its port once it listens."""

        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            if not self.should_exit:
                port_sender.send(listener.getsockname()[1])

    PortReportingServer(config).run(sockets=[listener])
