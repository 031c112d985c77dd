"""What browsers may do here: headers of pages, who asks from where, and addresses that work once.

Such are the login address that `headland serve` prints, and views of results in frames.

Whoever sees what `headland serve` prints is at this machine or was shown it. The address that a request comes from does
not prove that, as a proxy on this machine has it too. A frame of a page cannot send a token, so it gets a view.
"""

from __future__ import annotations

import hmac
import secrets
import threading
import time
from collections.abc import Callable, Sequence
from urllib.parse import urlsplit

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from planner.service.errors import BusyError, NotFoundError, ScopeError, TokenError
from planner.service.settings import LIMITS
from planner.service.store.tables import ResultRow

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
LOGIN_COOKIE = "headland_login"
LOGIN_PATH = "/login"


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


class BrowserLogins:
    """The code of the next login, and the browsers that have logged in since the start.

    When a code is used, `on_used` is called with the next one, so that it can be shown. `make_token`, if it is set,
    gives the browser that logs in a token of its own, or None.
    """

    on_used: Callable[[str], None] | None = None
    make_token: Callable[[], str | None] | None = None

    def __init__(self, *, secure: bool = False, clock: Callable[[], float] = time.monotonic) -> None:
        self.secure, self._clock = secure, clock
        self.code = secrets.token_urlsafe(24)
        self._valid_until: dict[str, float] = {}

    def redeem_code(self, code: str) -> str:
        """The value of the cookie for a code, which is then used up. Raises TokenError."""
        if not self.is_current_code(code):
            raise TokenError(
                "This login address is used up or from an earlier start; open the one that headland serve "
                "printed last.",
                parameter="code",
            )
        self.code = secrets.token_urlsafe(24)
        now = self._clock()
        self._valid_until = {cookie: until for cookie, until in self._valid_until.items() if until > now}
        while len(self._valid_until) >= LIMITS.most_logins:
            del self._valid_until[min(self._valid_until, key=lambda cookie: self._valid_until[cookie])]
        cookie = secrets.token_urlsafe(32)
        self._valid_until[cookie] = now + LIMITS.login_valid_s
        if self.on_used is not None:
            self.on_used(self.code)
        return cookie

    def is_current_code(self, code: str) -> bool:
        """Whether a code is the one that was shown last and is not used."""
        return hmac.compare_digest(code.encode("utf-8", "surrogatepass"), self.code.encode())

    def is_logged_in(self, connection: HTTPConnection) -> bool:
        """Whether a connection has the cookie of a browser that has logged in."""
        until = self._valid_until.get(connection.cookies.get(LOGIN_COOKIE, ""))
        return until is not None and until > self._clock()

    def log_in_browser(self, code: str) -> Response:
        """Log a browser in and redirect it to the start page. Raises TokenError."""
        response = RedirectResponse("/", 303, {"cache-control": "no-store"})
        response.set_cookie(
            LOGIN_COOKIE,
            self.redeem_code(code),
            max_age=int(LIMITS.login_valid_s),
            httponly=True,
            samesite="strict",
            secure=self.secure,
        )
        return response


class OneTimeViews:
    """Views that are not used yet; whoever knows the name of one may look at it once."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._lock = clock, threading.Lock()
        self._views: dict[str, tuple[float, ResultRow]] = {}

    def add_view(self, result: ResultRow) -> str:
        """The name of a new view; raises BusyError where too many are unused."""
        now, name = self._clock(), secrets.token_urlsafe(24)
        with self._lock:
            self._views = {key: each for key, each in self._views.items() if each[0] > now}
            if len(self._views) >= LIMITS.most_views:
                raise BusyError(f"{LIMITS.most_views} views are not looked at yet; ask again in a minute.")
            self._views[name] = (now + LIMITS.view_valid_s, result)
        return name

    def take_view(self, name: str) -> ResultRow:
        """The result that a view shows; the view is then used up. Raises NotFoundError."""
        with self._lock:
            until, result = self._views.pop(name, (0.0, None))
        if result is None or until <= self._clock():
            raise NotFoundError(
                "There is no such view, or it was looked at already; ask for another.", parameter="view"
            )
        return result
