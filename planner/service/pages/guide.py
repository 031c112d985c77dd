"""The guide at /guide: rendered pages and a search, offline and without scripts."""

from __future__ import annotations

from html import escape

from fastapi import FastAPI
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from planner.errors import RequestError
from planner.guide.guide_pages import list_pages, read_attachment, read_page, render_matches, render_page

PAGE = """<!doctype html>
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


def mount_guide(app: FastAPI) -> None:
    """Serve the guide below /guide/; `?q=` searches it."""

    async def redirect_to_guide(_: Request) -> Response:
        return RedirectResponse("guide/")

    async def show_start(request: Request) -> Response:
        query = request.query_params.get("q", "")
        content = render_matches(query) if query.strip() else _render_topic_list()
        return HTMLResponse(_build_page("Search" if query.strip() else "Guide", content, query))

    async def show_topic(request: Request) -> Response:
        name = request.path_params["topic"]
        attachment = read_attachment(name)
        if attachment is not None:
            return Response(attachment[0], media_type=attachment[1])
        try:
            page = read_page(name)
        except RequestError as refusal:
            return HTMLResponse(_build_page("No such topic", f"<p>{escape(str(refusal))}</p>"), status_code=404)
        return HTMLResponse(_build_page(page.title, render_page(page)))

    app.add_route("/guide", redirect_to_guide, methods=["GET"], include_in_schema=False)
    app.add_route("/guide/", show_start, methods=["GET"], include_in_schema=False)
    app.add_route("/guide/{topic}", show_topic, methods=["GET"], include_in_schema=False)


def _render_topic_list() -> str:
    items = "".join(f'<li><a href="{page.topic}">{escape(page.title)}</a></li>' for page in list_pages())
    return f"<h1>Guide</h1><ul>{items}</ul>"


def _build_page(title: str, content: str, query: str = "") -> str:
    topics = "".join(f'<li><a href="{page.topic}">{escape(page.topic)}</a></li>' for page in list_pages())
    for box in ("pre", "table"):  # they may scroll, so keys must reach them
        content = content.replace(f"<{box}>", f'<{box} tabindex="0">')
    return PAGE.format(title=escape(title), content=content, topics=topics, query=escape(query[:80], quote=True))
