"""Addresses of real video, one per tractor of a fleet and stored with it; browsers load them, the service never does.

Only hosts that the administrator named count, as a browser reaches more than this service does; the page's content
security policy allows those in use and no others (access/browsers.py).
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Iterable, Mapping
from typing import Annotated, Any
from urllib.parse import SplitResult, urlsplit

from fastapi import Request
from pydantic import Field

from planner.service.access.browsers import STANDARD_PORT
from planner.service.access.permissions import OperateAccess
from planner.service.errors import NotFoundError, ServiceError
from planner.service.gateway.responses import ApiRequest, ApiRouter
from planner.service.settings import LIMITS

SETTINGS_KEY = "videos"
LONGEST_ADDRESS_CHARS = 500
GATEWAY_SCHEMES = ("rtsp", "rtsps", "rtmp", "rtmps", "udp", "srt")
PARAMETER = "address"
ALLOW_HOST = "headland serve --video-host, or give a path of this service's host"
_HOST = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?|\[[0-9A-Fa-f:.]+\]")
_ADDRESS_CHARACTERS = re.compile(r"[A-Za-z0-9._~:/?#\[\]@!$&()*+=%-]+")  # no blanks, quotes, commas and semicolons

video_router = ApiRouter(tags=["fleets"])


class VideoAddress(ApiRequest):
    """The address of an MJPEG or HLS stream: http, https, or a path of this service's host; null for none."""

    address: Annotated[str, Field(max_length=LONGEST_ADDRESS_CHARS)] | None


class VideoHosts:
    """The hosts on which addresses may be besides the service's own.

    Raises ServiceError for hosts that are none, or too many for the policy of pages.
    """

    def __init__(self, hosts: Iterable[str] = ()) -> None:
        self.origins = {_parse_host(host) for host in hosts}
        if len(" ".join(self.origins)) > LIMITS.most_origin_chars:
            raise ServiceError(
                f"The video hosts have more than {LIMITS.most_origin_chars} characters, for which answers have no "
                "room; let one gateway serve several videos.",
                parameter="video_host",
            )

    def is_allowed(self, address: str) -> bool:
        """Whether an address is on the service's own host or one that the administrator named."""
        return find_origin(address) in (None, *self.origins)

    def select_allowed(self, addresses: Mapping[int, str]) -> dict[int, str]:
        """Addresses by tractor, without those on hosts that are not allowed any more."""
        return {tractor: address for tractor, address in sorted(addresses.items()) if self.is_allowed(address)}

    def list_origins(self, addresses: Iterable[str]) -> list[str]:
        """Scheme, host and port of every allowed address that names a host."""
        return sorted(self.origins & {find_origin(one) for one in addresses})


def read_stored_addresses(settings: Mapping[str, Any]) -> dict[int, str]:
    """The addresses by tractor, counted from 1, in the stored settings of a fleet."""
    return {int(number): str(one) for number, one in settings.get(SETTINGS_KEY, {}).items()}


def _parse_host(host: str) -> str:
    """The origin that an administrator allows; raises ServiceError for what is more or less than one."""
    if (origin := find_origin(check_video_address(host))) is None or urlsplit(host).path.strip("/"):
        raise ServiceError(
            f"The video host {host[:80]!r} is none; give scheme, host and port, such as https://gateway.example:8443.",
            parameter="video_host",
        )
    return origin


def check_video_address(address: str) -> str:
    """Return a usable address; raises ServiceError, which says what to do instead."""
    if not _ADDRESS_CHARACTERS.fullmatch(address) or len(address) > LONGEST_ADDRESS_CHARS:
        raise _refuse(
            address, "is no address of a video; use letters, digits and the signs of addresses, without blanks"
        )
    try:
        parts = urlsplit(address)
        port = parts.port
    except ValueError:
        raise _refuse(address, "is no address of a video; check its host and port") from None
    if parts.scheme.lower() in GATEWAY_SCHEMES:
        raise _refuse(
            address,
            f"cannot be played by browsers, which know no {parts.scheme.upper()}; let a gateway such as MediaMTX make "
            "HLS of it, and give that address, which ends in .m3u8",
        )
    if parts.scheme:
        _check_host(address, parts, port)
    elif address.startswith("//") or not parts.path or ":" in parts.path.partition("/")[0]:
        raise _refuse(address, "is no address of a video; begin it with http://, https:// or the path on this host")
    return address


def _check_host(address: str, parts: SplitResult, port: int | None) -> None:
    if parts.scheme.lower() not in ("http", "https"):
        raise _refuse(address, "is neither http nor https, which browsers need; use one of them")
    if parts.username is not None or parts.password is not None or "@" in parts.netloc:
        raise _refuse(
            "The address", "names a user or password, which everybody who may look would see; protect the camera "
            "by its network or a gateway instead",
        )  # fmt: skip
    host = parts.netloc.removesuffix(f":{port}") if port is not None else parts.netloc
    if not _HOST.fullmatch(host):
        raise _refuse(address, "names no host; write it as http://camera.example/stream")


def _refuse(address: str, why: str) -> ServiceError:
    shown = address if address == "The address" else repr(address[:80])
    return ServiceError(f"{shown} {why}.", parameter=PARAMETER)


def find_origin(address: str) -> str | None:
    """Scheme, host and port of a checked address; None for a path on the service's own host."""
    parts = urlsplit(address)
    scheme = parts.scheme.lower()
    return f"{scheme}://{parts.netloc.lower().removesuffix(f':{STANDARD_PORT[scheme]}')}" if scheme else None


@video_router.put("/fleets/{id}/tractors/{tractor}/video")
async def set_video_address(
    request: Request, who: OperateAccess, id: str, tractor: int, body: VideoAddress
) -> VideoAddress:
    """Set the address of a tractor's video, or remove it; pages opened from then on may load it."""
    sessions = request.app.state.hub
    session, videos = sessions.get_session(id), sessions.get_label(id).videos
    if not 1 <= tractor <= session.tractor_count:
        raise NotFoundError(
            f"The fleet has no tractor {tractor}; use 1 to {session.tractor_count}.", parameter="tractor"
        )
    address = None if body.address is None else check_video_address(body.address)
    if address is not None and not sessions.video_hosts.is_allowed(address):
        raise _refuse(address, f"is on a host that is not allowed; ask the administrator for {ALLOW_HOST}")
    videos.pop(tractor, None)
    if address is not None:
        videos[tractor] = address
    stored = {str(number): one for number, one in sorted(videos.items())}
    await asyncio.to_thread(sessions.store.save_fleet_setting, id, SETTINGS_KEY, stored)
    await asyncio.to_thread(
        sessions.store.add_event, id, who.name, "video address", {"tractor": tractor, PARAMETER: address}
    )
    return VideoAddress(address=address)
