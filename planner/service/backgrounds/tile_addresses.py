"""The address of a tile server as its administrator gives it: a template of XYZ, WMTS or WMS.

Only numbers are put into it, behind its host, so no request can lead to another host or path than the administrator's.
"""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass
from urllib.parse import urlsplit

from planner.service.backgrounds.tile_grid import Tile
from planner.service.errors import ServiceError

TILE_PX = 256
EXAMPLE = "https://tiles.example/{z}/{x}/{y}.png"
NAMES = {
    "z": "zoom", "x": "column", "y": "row", "-y": "row_from_south",
    "tilematrix": "zoom", "tilecol": "column", "tilerow": "row",
    "bbox": "bounds", "bbox-epsg-3857": "bounds", "width": "width", "height": "width",
}  # fmt: skip
"""What stands in braces, in small letters, and what it becomes; the words of XYZ, TMS, WMTS and WMS."""
BRACES = re.compile(r"\{([^{}]*)\}")
LABEL = r"[A-Za-z0-9_](?:[A-Za-z0-9_-]{0,61}[A-Za-z0-9_])?"
HOST = re.compile(rf"(?=.{{1,253}}$){LABEL}(?:\.{LABEL})*\.?")
MOST_ADDRESS_CHARS = 1_000


@dataclass(frozen=True)
class TileAddress:
    """A checked template; `host` is the only one that is ever asked. Raises ServiceError."""

    template: str

    def __post_init__(self) -> None:
        _check_text(self.template)
        try:
            parts, _ = urlsplit(self.template), urlsplit(self.template).port
        except ValueError:
            shown = self.template.rpartition("@")[2]  # without a password
            raise _refuse(shown, "has a host or port that cannot be", f"give one such as {EXAMPLE}") from None
        _check_host(parts.hostname or "", self.template)
        if BRACES.search(parts.netloc):
            raise _refuse(self.template, "names no single host", f"write one host, as in {EXAMPLE}")
        if parts.username is not None or parts.password is not None:
            raise _refuse(
                parts.hostname or "",
                "holds a name and a password",
                "give a server that needs none, or a key in the query",
            )
        found = {NAMES[name.lower()] for name in BRACES.findall(self.template)}
        if not (found >= {"zoom", "column"} and found & {"row", "row_from_south"}) and "bounds" not in found:
            raise _refuse(
                self.template, "does not say which tile", "write {z}, {x} and {y} where zoom, column and row go"
            )

    @property
    def host(self) -> str:
        """The host that is asked, for messages."""
        return urlsplit(self.template).hostname or ""

    def build_url(self, tile: Tile) -> str:
        """The address of a tile."""
        values = {
            "zoom": tile.zoom,
            "column": tile.column,
            "row": tile.row,
            "row_from_south": 2**tile.zoom - 1 - tile.row,
            "bounds": ",".join(f"{value:.6f}" for value in tile.compute_bounds_m()),
            "width": TILE_PX,
        }
        return BRACES.sub(lambda found: str(values[NAMES[found[1].lower()]]), self.template)


def is_address(text: str) -> bool:
    """Whether a background is an address rather than a file."""
    return re.match(r"[A-Za-z][A-Za-z0-9+.-]+:", text) is not None


def _check_text(template: str) -> None:
    if not template.isascii() or not template.isprintable() or " " in template or "\\" in template:
        raise _refuse(template, "has characters that an address cannot have", "write them as % codes")
    if len(template) > MOST_ADDRESS_CHARS:
        raise _refuse(template, f"has {len(template)} characters", f"use at most {MOST_ADDRESS_CHARS}")
    if not template.startswith(("https://", "http://")):
        raise _refuse(template, "is not an address of the web", f"give one such as {EXAMPLE}")
    for name in BRACES.findall(template):
        if name.lower() not in NAMES:
            raise _refuse(template, f"has {{{name[:20]}}}", "use {z}, {x}, {y}, {-y} or {bbox}")


def _check_host(host: str, template: str) -> None:
    """Refuse no host, and addresses at which only a machine's own management answers."""
    if not host:
        raise _refuse(template, "names no host", f"give one such as {EXAMPLE}")
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        if not HOST.fullmatch(BRACES.sub("a", host)):
            raise _refuse(host, "is no host that can be", f"give one such as {EXAMPLE}") from None
        return
    if address.is_link_local or address.is_multicast or address.is_unspecified:
        raise _refuse(template, f"asks {host}, where no map can be", "give the host of a tile server")


def _refuse(what: str, fault: str, fix: str) -> ServiceError:
    return ServiceError(f"The background {what[:80]!r} {fault}; {fix}.", parameter="background")
