"""The page at / and its parts under /static, from the package itself."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from fastapi import FastAPI
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

STATIC = Path(__file__).parent / "static"
HEADERS = {"cache-control": "no-cache"}
"""A browser asks whether a part is still the same: after an update it never mixes old and new ones."""


class _Parts(StaticFiles):
    """Static files with the headers of the page."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        """The file, or the 404 of StaticFiles."""
        response = await super().get_response(path, scope)
        response.headers.update(HEADERS)
        return response


def mount(app: FastAPI) -> None:
    """Serve the page: / and /static; what it shows is told by the part of the address after #.

    What a browser is to refuse is told by planner.service.access.headers, as for every answer.
    """

    async def page(_: Request) -> Response:
        return FileResponse(STATIC / "index.html", headers=HEADERS)

    async def example_day(_: Request) -> Response:
        text = files("planner.day").joinpath("example.toml").read_text(encoding="utf-8")
        return Response(text, media_type="text/plain; charset=utf-8", headers=HEADERS)

    app.add_route("/", page, methods=["GET"], include_in_schema=False)
    app.add_route("/static/example-day.toml", example_day, methods=["GET"], include_in_schema=False)
    app.mount("/static", _Parts(directory=STATIC), name="static")
