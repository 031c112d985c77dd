"""The query and the form of a request: what its route does not know is refused, not passed over."""

from __future__ import annotations

from collections.abc import Iterator

from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute
from starlette.requests import HTTPConnection, Request

from planner.errors import nearest
from planner.service.errors import ServiceError


def known_query(connection: HTTPConnection) -> None:
    """A dependency of all routes; raises ServiceError for the first parameter that this one does not have."""
    route = connection.scope.get("route")
    if not isinstance(route, APIRoute):
        return
    known = sorted(set(_names(route.dependant)))
    for name in connection.query_params:
        if name not in known:
            takes = f"it takes {', '.join(known)}" if known else "it takes none"
            raise ServiceError(
                f"{name[:40]!r} is no parameter of this address; {takes}{nearest(name, known)}.", parameter=name[:40]
            )


async def known_form(request: Request) -> None:
    """A dependency of uploads; raises ServiceError for the first part of a form that this one does not have."""
    route = request.scope["route"]
    known = sorted(each.alias for each in route.dependant.body_params)
    for name in await request.form():
        if name not in known:
            sentence = f"{name[:40]!r} is no part of this form; it takes {', '.join(known)}{nearest(name, known)}."
            raise ServiceError(sentence, parameter=name[:40])


def _names(dependant: Dependant) -> Iterator[str]:
    yield from (each.alias for each in dependant.query_params)
    for each in dependant.dependencies:
        yield from _names(each)
