"""What must make a tractor stand, and keep it standing, by a clock that the tests turn."""

from __future__ import annotations

import asyncio
import json
import math
from typing import Any

from planner.service.centre.orders import Order
from planner.service.centre.rules import Rules
from planner.service.centre.tractors import Report
from planner.service.links.clients import CONTROL, TRACTOR, Client
from planner.service.links.live import LiveFleet
from tests.service.fleets import Driven, driven, fleet_plan


def live() -> tuple[LiveFleet, Client, Client]:
    """A fleet with one tractor linked and one operator, whose outboxes nobody empties."""
    fleet = LiveFleet("f", "small", fleet_plan(), Rules(), begin_s=0.0)
    tractor, operator = Client(TRACTOR, "tractor 1", 0), Client(CONTROL, "anna")
    fleet.join(tractor, 0.0)
    fleet.join(operator, 0.0)
    return fleet, tractor, operator


def remote(x: float = 0.0, y: float = 10.0, heading: float = math.pi / 2) -> Driven:
    """A fleet whose first tractor is driven by an operator, and stands there."""
    fleet = driven()
    fleet.centre.lease("anna", 0, False, fleet.now)
    fleet.obey()
    fleet.silent = {0}
    fleet.centre.reported(0, Report(x, y, heading, 0.0, mode="remote"), fleet.now)
    return fleet


def waiting(client: Client) -> list[dict[str, Any]]:
    """All that waits to be sent to a client, which takes it."""
    return [json.loads(asyncio.run(client.outbox.take()) or "") for _ in range(len(client.outbox))]


def test_nothing_older_that_sets_a_tractor_in_motion_arrives_after_a_stop() -> None:
    fleet, tractor, _ = live()
    waiting(tractor)
    fleet.centre.start("anna", 0.0)
    fleet.flush()
    fleet._send(Order(0, "command", {"steering_rad": 0.0, "speed_mps": 1.0}), False)
    fleet.centre.stop_all("anna", 0.0)
    fleet.flush()
    fleet.centre.resume("anna", None, 0.0)
    fleet.flush()
    assert [frame["kind"] for frame in waiting(tractor)] == ["stop", "resume"]


def test_a_lease_taken_over_or_again_stops_what_the_last_command_set_in_motion() -> None:
    for who in ("bert", "anna"):
        fleet = remote()
        fleet.centre.command("anna", 0, 0.0, 1.0, fleet.now)
        fleet.centre.taken()
        fleet.centre.lease(who, 0, True, fleet.now)
        assert [(order.tractor, order.kind) for order in fleet.centre.taken()[0]] == [(0, "stop")]
