"""Serves the page at /, its files under /static from this package, and the guide at /guide.

The endings of files that each upload takes are a script of their own, js/accepted.js. The guide has rendered pages and
a search, offline and without scripts.
"""

from __future__ import annotations

import json
from html import escape
from pathlib import Path

from fastapi import FastAPI
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

from planner.errors import RequestError
from planner.farm.settings import read_example_text
from planner.guide.guide_pages import list_pages, read_attachment, read_page, render_matches, render_page
from planner.service.store.service_store import SUFFIXES_BY_KIND
from reports.common.language import find_language, get_messages

STATIC_FOLDER = Path(__file__).parent / "static"
CACHE_HEADERS = {"cache-control": "no-cache"}
"""Browsers revalidate every file, so that an update never mixes old and new ones."""
GUIDE_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{title} - Headland guide</title>
<link rel="icon" href="../static/mark.svg" type="image/svg+xml">
<link rel="stylesheet" href="../static/css/tokens.css">
<link rel="stylesheet" href="../static/css/base.css">
<link rel="stylesheet" href="../static/css/guide.css">
</head>
<body>
<header class="guide-bar"><a href="../">Headland</a><a href="./">Guide</a>
<form action="./" role="search">
<input type="search" name="q" value="{query}" aria-label="Search the guide" placeholder="Search">
</form></header>
<div class="guide"><nav aria-label="Topics"><ul>{topics}</ul></nav><main id="main">{content}</main></div>
</body>
</html>
"""


class _PageFiles(StaticFiles):
    """Static files with the headers of the page."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        """The file, or the 404 of StaticFiles."""
        response = await super().get_response(path, scope)
        response.headers.update(CACHE_HEADERS)
        return response


def mount_pages(app: FastAPI) -> None:
    """Serve the page: / and /static; the part of the address after # selects what it shows.

    Security headers are set by planner.service.access.browsers, as for every answer.
    """

    async def show_page(_: Request) -> Response:
        return FileResponse(STATIC_FOLDER / "index.html", headers=CACHE_HEADERS)

    async def show_example_day(_: Request) -> Response:
        return Response(read_example_text("day"), media_type="text/plain; charset=utf-8", headers=CACHE_HEADERS)

    async def send_accepted(_: Request) -> Response:
        accepted = {f"{kind}s": ",".join(suffixes) for kind, suffixes in SUFFIXES_BY_KIND.items()}
        script = f"export const ACCEPTED = {json.dumps(accepted)};\n"
        return Response(script, media_type="text/javascript; charset=utf-8", headers=CACHE_HEADERS)

    async def send_catalogue(request: Request) -> Response:
        return JSONResponse(get_messages(find_language(request.path_params["language"])), headers=CACHE_HEADERS)

    app.add_route("/", show_page, methods=["GET"], include_in_schema=False)
    app.add_route("/static/example-day.toml", show_example_day, methods=["GET"], include_in_schema=False)
    app.add_route("/static/js/accepted.js", send_accepted, methods=["GET"], include_in_schema=False)
    app.add_route("/static/languages/{language}.json", send_catalogue, methods=["GET"], include_in_schema=False)
    _mount_guide(app)
    app.mount("/static", _PageFiles(directory=STATIC_FOLDER), name="static")


def _mount_guide(app: FastAPI) -> None:
    """Serve the guide below /guide/; `?q=` searches it."""

    async def redirect_to_guide(_: Request) -> Response:
        return RedirectResponse("guide/")

    async def show_start(request: Request) -> Response:
        query = request.query_params.get("q", "")
        if query.strip():
            return HTMLResponse(_build_guide_page("Search", render_matches(query), query))
        items = "".join(f'<li><a href="{page.topic}">{escape(page.title)}</a></li>' for page in list_pages())
        return HTMLResponse(_build_guide_page("Guide", f"<h1>Guide</h1><ul>{items}</ul>", query))

    async def show_topic(request: Request) -> Response:
        name = request.path_params["topic"]
        attachment = read_attachment(name)
        if attachment is not None:
            return Response(attachment[0], media_type=attachment[1])
        try:
            page = read_page(name)
        except RequestError as refusal:
            return HTMLResponse(_build_guide_page("No such topic", f"<p>{escape(str(refusal))}</p>"), status_code=404)
        return HTMLResponse(_build_guide_page(page.title, render_page(page)))

    app.add_route("/guide", redirect_to_guide, methods=["GET"], include_in_schema=False)
    app.add_route("/guide/", show_start, methods=["GET"], include_in_schema=False)
    app.add_route("/guide/{topic}", show_topic, methods=["GET"], include_in_schema=False)


def _build_guide_page(title: str, content: str, query: str = "") -> str:
    topics = "".join(f'<li><a href="{page.topic}">{escape(page.topic)}</a></li>' for page in list_pages())
    for box in ("pre", "table"):  # they may scroll, so keys must reach them
        content = content.replace(f"<{box}>", f'<{box} tabindex="0">')
    return GUIDE_PAGE.format(title=escape(title), content=content, topics=topics, query=escape(query[:80], quote=True))
