"""Addresses of video: what is one, who may set it, what the page may then load, and that it is kept."""

import asyncio
import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from planner.service.access.browsers import CONTENT_SECURITY_POLICY, build_page_policy
from planner.service.errors import ServiceError
from planner.service.fleets.fleet_sessions import FleetLabel
from planner.service.fleets.video_addresses import VideoHosts, check_video_address, find_origin, read_stored_addresses
from planner.service.settings import ServiceSettings
from tests.service.conftest import bearer

PUT = "/api/v1/fleets/f1/tractors/{}/video"
CAMERA = "https://gateway.example:8443/tractor-1/index.m3u8"


class Session:
    """As much of a fleet as the route asks."""

    id, name, tractor_count = "f1", "north", 2


@pytest.fixture
def settings(settings: ServiceSettings) -> ServiceSettings:
    """Settings with the gateway of the camera."""
    return replace(settings, video_hosts=("https://gateway.example:8443",))


@pytest.fixture
def fleet(app: FastAPI, client: TestClient, monkeypatch: pytest.MonkeyPatch) -> Iterator[TestClient]:
    app.state.store.save_fleet("f1", "north", "{}", {"times": 1.0})
    app.state.hub.labels["f1"] = FleetLabel("f1", "north", "2026-11-20T08:00:00Z")
    monkeypatch.setattr(app.state.hub, "get_session", lambda _: Session())
    yield client


@pytest.mark.parametrize(
    "address",
    [
        "http://camera/stream", CAMERA, "http://192.168.1.20:8080/?action=stream", "http://[fd00::5]:81/cam",
        "/video/1.m3u8", "video/1.mjpg",
    ],
)  # fmt: skip
def test_http_and_paths_are_addresses(address: str) -> None:
    assert check_video_address(address) == address


@pytest.mark.parametrize(
    ("address", "why"),
    [
        ("rtsp://camera/1", "which know no RTSP"), ("javascript:alert(1)", "neither http nor https"),
        ("data:image/png;base64,AA", "letters, digits"), ("//camera/1", "begin it with http"), ("", "letters, digits"),
        ("///camera/1", "begin it with http"),
        ("http://a b/", "letters, digits"), ("http://camera; script-src *", "letters, digits"),
        ("http://camera,http://other/", "letters, digits"), ("http://anna:secret@camera/1", "user or password"),
        ("http:///1", "names no host"), ("http://*/1", "names no host"), ("http://camera:99999/", "host and port"),
        ("http://'self'/", "letters, digits"), ("ftp://camera/1", "neither http nor https"), ("camera:8080", "neither"),
    ],
)  # fmt: skip
def test_all_else_is_refused_in_a_sentence_that_keeps_secrets(address: str, why: str) -> None:
    with pytest.raises(ServiceError) as refusal:
        check_video_address(address)
    assert why in str(refusal.value) and str(refusal.value).endswith(".") and "secret" not in str(refusal.value)


def test_the_policy_allows_the_hosts_of_addresses_and_no_others() -> None:
    hosts = VideoHosts(["https://gateway.example:8443", "http://camera.example:80/", "http://unused.example"])
    stored = {"videos": {"1": CAMERA, "2": "/video/2.m3u8", "3": "http://192.168.1.1/reboot"}}
    addresses = read_stored_addresses(stored)
    assert hosts.select_allowed(addresses) == {1: CAMERA, 2: "/video/2.m3u8"}
    origins = hosts.list_origins([*addresses.values(), CAMERA, "HTTP://Camera.example/a/b.mjpg"])
    assert origins == ["http://camera.example", "https://gateway.example:8443"]
    policy = build_page_policy(origins)
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["media-src"] == "'self' http://camera.example https://gateway.example:8443"
    assert rules["img-src"] == f"'self' data: blob: {rules['media-src'].removeprefix(chr(39) + 'self' + chr(39) + ' ')}"
    others = dict(rule.strip().split(" ", 1) for rule in CONTENT_SECURITY_POLICY.split(";"))
    assert {key: value for key, value in rules.items() if key not in ("img-src", "media-src")} == {
        key: value for key, value in others.items() if key != "img-src"
    }
    assert build_page_policy([]) == CONTENT_SECURITY_POLICY
    assert find_origin("/video/2.m3u8") is None


def test_hosts_are_refused_that_are_not_scheme_host_and_port_or_for_which_the_policy_has_no_room() -> None:
    for host in ("camera.example", "/video", "https://camera.example/path", "rtsp://camera", ""):
        with pytest.raises(ServiceError):
            VideoHosts([host])
    hosts = [f"https://camera-{number:02}.farm.example" for number in range(30)]
    addresses = [f"{host}/live.m3u8" for host in hosts]
    assert VideoHosts(hosts).list_origins(addresses) == hosts and len(build_page_policy(hosts)) < 2600
    with pytest.raises(ServiceError, match="one gateway"):
        VideoHosts([*hosts, *(f"https://camera-{number}.farm.example" for number in range(30, 33))])


@pytest.mark.parametrize(
    "address",
    ["https://gateway.example/1", "http://gateway.example:8443/1", "https://gateway.example:8443.evil.example/1",
     "https://evil.example/?https://gateway.example:8443", "http://127.0.0.1/", "http://[::1]:8443/"],
)  # fmt: skip
def test_only_hosts_that_the_administrator_named_are_allowed(address: str) -> None:
    videos = VideoHosts(["https://gateway.example:8443"])
    assert videos.is_allowed(CAMERA) and videos.is_allowed("HTTPS://Gateway.Example:8443/2")
    assert videos.is_allowed("/video/1/index.m3u8") and not videos.is_allowed(address)


@pytest.mark.slow
def test_operators_set_it_and_pages_may_load_it_until_it_is_removed(app: FastAPI, fleet: TestClient) -> None:
    operator = bearer(app, "operator")
    assert fleet.put(PUT.format(1), json={"address": CAMERA}).status_code == 401
    assert fleet.put(PUT.format(1), json={"address": CAMERA}, headers=bearer(app, "planner")).status_code == 403
    assert CAMERA.split("/")[2] not in fleet.get("/").headers["content-security-policy"]
    assert fleet.put(PUT.format(1), json={"address": CAMERA}, headers=operator).json() == {"address": CAMERA}
    assert "media-src 'self' https://gateway.example:8443" in fleet.get("/").headers["content-security-policy"]
    kept = app.state.store.get_fleet("f1").settings
    assert kept == {"times": 1.0, "videos": {"1": CAMERA}}
    assert app.state.store.list_events(fleet="f1")[-1].data == {"tractor": 1, "address": CAMERA}
    refused = fleet.put(PUT.format(1), json={"address": "rtsp://camera/1"}, headers=operator)
    assert refused.status_code == 422 and refused.json()["parameter"] == "address"
    refused = fleet.put(PUT.format(1), json={"address": "http://192.168.1.1/reboot"}, headers=operator)
    assert refused.status_code == 422 and "--video-host" in refused.json()["error"]
    assert fleet.put(PUT.format(3), json={"address": CAMERA}, headers=operator).status_code == 404
    assert fleet.put(PUT.format(1), json={"address": None}, headers=operator).json() == {"address": None}
    assert not re.search("media-src", fleet.get("/").headers["content-security-policy"])


def test_addresses_are_there_again_after_a_restart(
    app: FastAPI, fleet: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def refuse(*_: object) -> None:
        raise ServiceError("The plan is not read here.")

    app.state.store.save_fleet_setting("f1", "videos", {"2": CAMERA})
    hub: Any = app.state.hub
    monkeypatch.setattr(hub, "run_in_process", refuse)
    asyncio.run(hub.restore_sessions())
    assert hub.labels["f1"].videos == {2: CAMERA} and hub.list_video_origins() == ["https://gateway.example:8443"]
    asyncio.run(hub.delete("f1"))
    assert hub.list_video_origins() == []
