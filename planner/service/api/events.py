"""Who did what, and when."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Query, Request

from planner.service.access import Who, needs
from planner.service.api.answers import READS, EventList
from planner.service.store import Store

LARGEST = 2**53
router = APIRouter(tags=["events"])


@router.get("/events", responses=READS)
def events(
    request: Request,
    _who: Annotated[Who, Depends(needs("read"))],
    since: Annotated[int, Query(ge=0, le=LARGEST, description="Only events of a higher number.")] = 0,
    fleet: Annotated[str | None, Query(max_length=32, description="Only events of this fleet.")] = None,
) -> EventList:
    """Events after a number, the oldest first, at most 1000: ask again from the last."""
    store: Store = request.app.state.store
    return EventList.model_validate({"items": store.events(since, fleet)})
