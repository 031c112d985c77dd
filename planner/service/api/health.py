"""Whether the service runs; told to everybody."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

from fastapi import APIRouter, Request

from planner.service.api.answers import Health, refusals

router = APIRouter(tags=["service"])


@router.get("/health", responses=refusals())
def health(request: Request) -> Health:
    """That the service runs, its version, and whether reading from this machine needs a token."""
    return Health(version=own_version(), tokens_needed=not request.app.state.settings.local)


def own_version() -> str:
    """The version of Headland that is installed."""
    try:
        return version("headland")
    except PackageNotFoundError:
        return "unknown"
