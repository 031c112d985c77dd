"""The documentation page, with all it needs beside it: no internet, no script in the page."""

from __future__ import annotations

from importlib import resources

from fastapi import APIRouter, Response

ASSETS = {
    "swagger-ui-bundle.js": "text/javascript; charset=utf-8",
    "swagger-ui.css": "text/css; charset=utf-8",
    "favicon-32x32.png": "image/png",
}
PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>Headland: the service</title>
<link rel="icon" href="docs/favicon-32x32.png"><link rel="stylesheet" href="docs/swagger-ui.css"></head>
<body><div id="docs"></div><script src="docs/swagger-ui-bundle.js"></script><script src="docs/start.js"></script></body>
</html>
"""
START = 'SwaggerUIBundle({url: "openapi.json", dom_id: "#docs", deepLinking: true, persistAuthorization: false});\n'

router = APIRouter(include_in_schema=False)


@router.get("/docs")
def page() -> Response:
    """The page."""
    return Response(PAGE, media_type="text/html; charset=utf-8")


@router.get("/docs/start.js")
def start() -> Response:
    """The script that fills it."""
    return Response(START, media_type="text/javascript; charset=utf-8")


def _add_asset(name: str, media: str) -> None:
    @router.get(f"/docs/{name}")
    def asset() -> Response:
        content = (resources.files("fastapi_swagger.resources") / name).read_bytes()
        return Response(content, media_type=media, headers={"cache-control": "max-age=86400"})


for _name, _media in ASSETS.items():
    _add_asset(_name, _media)
