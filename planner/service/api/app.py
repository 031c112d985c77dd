"""The app: routes, refusals, limits, and what has to run beside them."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import APIRouter, FastAPI

from planner.service.access.headers import SecurityHeaders
from planner.service.access.limits import Limits
from planner.service.api import events, health
from planner.service.api.health import own_version
from planner.service.api.refusals import add_refusals
from planner.service.links import fleets, link
from planner.service.links.hub import Hub
from planner.service.settings import Settings
from planner.service.store import Store

PREFIX = "/api/v1"
ABOUT = "Plan, watch and drive fleets. Lists are {items: [...]}, refusals {error: sentence, parameter: name or null}."


def create_app(settings: Settings) -> FastAPI:
    """The service; its store is open, and its workers run from its start to its end. Raises DatabaseError."""
    app = FastAPI(
        title="Headland", version=own_version(), description=ABOUT, lifespan=_life, docs_url=None, redoc_url=None,
        openapi_url=f"{PREFIX}/openapi.json", swagger_ui_oauth2_redirect_url=None,
    )  # fmt: skip
    app.state.settings = settings
    app.state.store = Store(settings)
    app.state.hub = Hub(app.state.store)
    api = APIRouter(prefix=PREFIX)
    for each in (health, events, fleets, link):
        api.include_router(each.router)
    app.include_router(api)
    add_refusals(app, lambda parameter: parameter)
    app.add_middleware(Limits, settings=settings)
    app.add_middleware(SecurityHeaders)
    return app


@asynccontextmanager
async def _life(app: FastAPI) -> AsyncIterator[None]:
    await app.state.hub.start()
    try:
        yield
    finally:
        await app.state.hub.stop()
        app.state.store.close()
