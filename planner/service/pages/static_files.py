"""Serves the page at / and its files under /static from this package."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from fastapi import FastAPI
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

from planner.service.pages.guide import mount_guide
from reports.common.language import find_language, get_messages

STATIC_FOLDER = Path(__file__).parent / "static"
CACHE_HEADERS = {"cache-control": "no-cache"}
"""Browsers revalidate every file, so that an update never mixes old and new ones."""


class _PageFiles(StaticFiles):
    """Static files with the headers of the page."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        """The file, or the 404 of StaticFiles."""
        response = await super().get_response(path, scope)
        response.headers.update(CACHE_HEADERS)
        return response


def mount_pages(app: FastAPI) -> None:
    """Serve the page: / and /static; the part of the address after # selects what it shows.

    Security headers are set by planner.service.access.browser_policy, as for every answer.
    """

    async def show_page(_: Request) -> Response:
        return FileResponse(STATIC_FOLDER / "index.html", headers=CACHE_HEADERS)

    async def show_example_day(_: Request) -> Response:
        text = files("planner.day").joinpath("example.toml").read_text(encoding="utf-8")
        return Response(text, media_type="text/plain; charset=utf-8", headers=CACHE_HEADERS)

    async def send_catalogue(request: Request) -> Response:
        return JSONResponse(get_messages(find_language(request.path_params["language"])), headers=CACHE_HEADERS)

    app.add_route("/", show_page, methods=["GET"], include_in_schema=False)
    app.add_route("/static/example-day.toml", show_example_day, methods=["GET"], include_in_schema=False)
    app.add_route("/static/languages/{language}.json", send_catalogue, methods=["GET"], include_in_schema=False)
    mount_guide(app)
    app.mount("/static", _PageFiles(directory=STATIC_FOLDER), name="static")
