"""The app: routes, refusals, limits, and what has to run beside them."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator

from fastapi import APIRouter, Depends, FastAPI
from sqlalchemy.exc import DBAPIError

from planner.parameters import word_of
from planner.service.access.headers import SecurityHeaders
from planner.service.access.limits import Limits
from planner.service.access.views import Views
from planner.service.api import docs, events, exports, health, tokens
from planner.service.api.answers import refusals
from planner.service.api.files import KINDS as FILES
from planner.service.api.files import files_router
from planner.service.api.health import own_version
from planner.service.api.jobs import KINDS as JOBS
from planner.service.api.jobs import every_job, jobs_router, views
from planner.service.api.queries import known_query
from planner.service.api.refusals import add_refusals
from planner.service.jobs.reading import Reader
from planner.service.jobs.supervisor import Supervisor
from planner.service.links import fleets, link, twins
from planner.service.links.diagnosing import Diagnosing
from planner.service.links.hub import Hub
from planner.service.pages import mount
from planner.service.settings import Settings
from planner.service.store import Store
from planner.service.store.backup import sweep

PREFIX = "/api/v1"
SWEEP_S = 3600.0
ABOUT = "Plan, watch and drive fleets. Lists are {items: [...]}, refusals {error: sentence, parameter: name or null}."


def create_app(settings: Settings, *, inline: bool = False) -> FastAPI:
    """The service; its store is open, and its workers run from its start to its end.

    Files are read in a process of their own, or with `inline` in this one. Raises DatabaseError.
    """
    app = FastAPI(
        title="Headland", version=own_version(), description=ABOUT, lifespan=_life, docs_url=None, redoc_url=None,
        openapi_url=f"{PREFIX}/openapi.json", swagger_ui_oauth2_redirect_url=None,
    )  # fmt: skip
    app.state.settings = settings
    app.state.store = store = Store(settings)
    app.state.supervisor = Supervisor(settings, store)
    app.state.views = Views()
    app.state.reader = Reader(settings, store, inline=inline)
    app.state.diagnosing = Diagnosing(store, app.state.reader)
    app.state.hub = Hub(store, app.state.diagnosing.look)
    api = APIRouter(prefix=PREFIX, dependencies=[Depends(known_query)], responses=refusals(422))
    parts = [health.router, *map(files_router, FILES), *map(jobs_router, JOBS), exports.router, every_job, views]
    parts += [tokens.router, events.router, docs.router, fleets.router, twins.router, link.router]
    for router in parts:
        api.include_router(router)
    app.include_router(api)
    mount(app)
    add_refusals(app, word_of)
    app.add_middleware(Limits, settings=settings)
    app.add_middleware(SecurityHeaders)
    return app


@contextlib.asynccontextmanager
async def _life(app: FastAPI) -> AsyncIterator[None]:
    await app.state.hub.start()
    sweeping: asyncio.Task[None] | None = None
    try:
        await asyncio.to_thread(sweep, app.state.store)
        sweeping = asyncio.create_task(_sweep_for_ever(app.state.store))
        app.state.supervisor.start()
        app.state.reader.warm()
        yield
    finally:
        if sweeping is not None:
            sweeping.cancel()
        await app.state.hub.stop()
        await asyncio.to_thread(app.state.supervisor.stop)
        app.state.reader.close()
        app.state.store.close()


async def _sweep_for_ever(store: Store) -> None:
    """Bytes of refused uploads and of what was deleted go while the service runs, too."""
    while True:
        await asyncio.sleep(SWEEP_S)
        with contextlib.suppress(DBAPIError):
            await asyncio.to_thread(sweep, store)
