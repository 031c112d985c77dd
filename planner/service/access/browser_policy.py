"""Security headers of every answer, and the refusal of requests from pages of other sites."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from urllib.parse import urlsplit

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from planner.service.errors import ScopeError

CONTENT_SECURITY_POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; object-src 'none'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'none'"
)
"""Nothing from other sites and no inline script, so that text in data cannot run as a script."""
REPORT_SECURITY_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:; frame-ancestors 'self'"
)
"""For a page made by a job: its own script and style, nothing else, and no access to this site."""
SECURITY_POLICY_HEADER = "content-security-policy"
SECURITY_HEADERS = {
    SECURITY_POLICY_HEADER: CONTENT_SECURITY_POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}
STANDARD_PORT = {"http": 80, "https": 443}
SAME_SITE_FETCHES = ("same-origin", "none")


def build_page_policy(video_origins: Sequence[str]) -> str:
    """The policy of pages that may load video from these origins (scheme, host and port) as well."""
    if not video_origins:
        return CONTENT_SECURITY_POLICY
    pictures = "img-src 'self' data: blob:"
    hosts = " ".join(video_origins)
    return CONTENT_SECURITY_POLICY.replace(pictures, f"{pictures} {hosts}; media-src 'self' {hosts}")


class SecurityHeadersMiddleware:
    """Adds the headers to every answer that does not have its own.

    `list_video_origins` gives the hosts from which pages may load pictures and films besides the service's own.
    """

    def __init__(self, app: ASGIApp, list_video_origins: Callable[[], Sequence[str]] = tuple) -> None:
        self.app, self.list_video_origins = app, list_video_origins

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The ASGI entry point."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in SECURITY_HEADERS.items():
                    headers.setdefault(name, value)
                if headers[SECURITY_POLICY_HEADER] == CONTENT_SECURITY_POLICY:
                    headers[SECURITY_POLICY_HEADER] = build_page_policy(self.list_video_origins())
            await send(message)

        await self.app(scope, receive, send_with_headers)


def check_origin(connection: HTTPConnection) -> None:
    """Raise ScopeError where a browser says that the request comes from a page of another site.

    Programs other than browsers send no Origin and pass: no page can make them send a request. Behind a proxy the
    service cannot know whether a browser came by http or https; where the port is missing, it is the default one of
    the page's own scheme, as browsers leave it out for both.
    """
    origin = connection.headers.get("origin")
    if origin is None:
        return
    public = connection.app.state.settings.public_url
    is_own_page = _parse_address(origin) == _parse_address(origin, connection.headers.get("host", ""))
    is_own_page = is_own_page or (public != "" and _parse_address(origin) == _parse_address(public))
    if not is_own_page or connection.headers.get("sec-fetch-site", SAME_SITE_FETCHES[0]) not in SAME_SITE_FETCHES:
        raise ScopeError(f"This request comes from a page of {origin[:80]!r}; only pages of this service may send it.")


def _parse_address(url: str, host: str | None = None) -> tuple[str, int]:
    """Host and port of a URL, or of a header Host as seen by a page of this URL; an unreadable one matches nothing."""
    try:
        scheme = urlsplit(url).scheme
        parts = urlsplit(url if host is None else f"{scheme}://{host}")
        return parts.hostname or "", parts.port or STANDARD_PORT[scheme]
    except (ValueError, KeyError):
        return "", -1 if host is None else -2
