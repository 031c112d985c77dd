"""Pages of other sites, and other names for this machine, are not listened to."""

from __future__ import annotations

from urllib.parse import urlsplit

from starlette.requests import HTTPConnection

from planner.service.errors import ScopeError
from planner.service.settings import is_loopback

STANDARD_PORT = {"http": 80, "https": 443, "ws": 80, "wss": 443}


def check_origin(connection: HTTPConnection) -> None:
    """Raise ScopeError where a browser says that the page which asks is not one of this service.

    Programs that are no browsers send no Origin and pass: they cannot be made to ask by a page.
    """
    origin = connection.headers.get("origin")
    if origin is not None and _address(origin) != _address(f"{connection.url.scheme}://{_host(connection)}"):
        raise ScopeError(f"A page of {origin[:80]!r} asked; only pages of this service may.")


def names_this_machine(connection: HTTPConnection) -> bool:
    """Whether the caller used a name that is this machine's whoever resolves it.

    A page of another site can have its own name lead here; it cannot make a browser ask for 127.0.0.1 in that name.
    """
    return is_loopback(_address(f"http://{_host(connection)}")[0])


def _host(connection: HTTPConnection) -> str:
    return connection.headers.get("host", "")


def _address(url: str) -> tuple[str, int]:
    """Host and port; what is no address is nobody's."""
    try:
        parts = urlsplit(url)
        return parts.hostname or "", parts.port or STANDARD_PORT.get(parts.scheme, 0)
    except ValueError:
        return "", 0
