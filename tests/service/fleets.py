"""A small fleet to watch: straight legs of 20 m side by side, and tractors that drive them at a steady speed."""

import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

import numpy as np
import shapely
from fastapi import FastAPI

from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.manager.progress_snapshot import capture_progress, restore_progress
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.rules import FleetRules
from planner.fleet.model.timed_mission import TimedMission
from planner.fleet.model.tractor_state import FleetEvent, TractorOrder, TractorReport
from planner.request.plan_request import PlanRequest
from planner.service.access.browsers import BrowserLogins
from planner.service.api.administration import ServiceMetrics
from planner.service.fleets.fleet_routes import fleet_router, recording_router
from planner.service.fleets.fleet_sessions import FleetSessions
from planner.service.fleets.fleet_socket import PENDING_LIMITS, link_router
from planner.service.fleets.twin_routes import TwinDiagnosis, twin_router
from planner.service.gateway.connection_limits import ConnectionRegistry
from planner.service.gateway.responses import add_error_handlers
from planner.service.store.service_store import Store
from tests.service.one_process import ReaderHere
from vehicle.missions.plan import SWATH, Leg, LegGate, LegTask, Mission, Plan
from vehicle.missions.plan_file import SavedPlan, format_plan
from vehicle.model.tractor import Implement, load_tractor

SPEED, LENGTH = 1.0, 20.0
EG105, BAR = load_tractor("eg105"), Implement(width_m=2.0)
Gates = dict[tuple[int, int], tuple[LegGate, ...]]


def fleet_app(store: Store, hub: FleetSessions) -> FastAPI:
    """The routes of fleets, links and twins alone, over the sessions of a test."""

    @asynccontextmanager
    async def life(_app: FastAPI) -> AsyncIterator[None]:
        await hub.start()
        yield
        await hub.stop()

    app = FastAPI(lifespan=life)
    app.state.settings, app.state.store, app.state.hub, app.state.book = store.settings, store, hub, hub.book
    app.state.logins, app.state.metrics = BrowserLogins(), ServiceMetrics()
    app.state.greetings = ConnectionRegistry(PENDING_LIMITS)
    app.state.diagnosing = TwinDiagnosis(store, ReaderHere(store.settings, store))
    for router in (link_router, fleet_router, twin_router, recording_router):
        app.include_router(router, prefix="/api/v1")
    add_error_handlers(app)
    return app


def fleet_plan(
    tractors: int = 2, legs: int = 3, gates: Gates | None = None, apart_m: float = 20.0, length_m: float = LENGTH
) -> FleetPlan:
    """Every tractor drives north on a line of its own, `apart_m` from the next one, in legs of `length_m`."""

    def lay_leg(number: int, k: int) -> Leg:
        points = np.array([[apart_m * number, length_m * k], [apart_m * number, length_m * (k + 1)]])
        waits = (gates or {}).get((number, k), ())
        return Leg(points, SPEED, implement=k % 2 == 0, task=LegTask(SWATH, number), gates=waits)

    missions = tuple(Mission(tuple(lay_leg(number, k) for k in range(legs))) for number in range(tractors))
    courses = tuple(TimedMission(mission, (length_m / SPEED,) * legs) for mission in missions)
    ground = shapely.box(-5.0, -5.0, apart_m * (tractors - 1) + 5.0, length_m * legs + 5.0)
    saved, finish_s = SavedPlan(Plan(missions), None, (1000.0, 2000.0), {}), (length_m * legs / SPEED,) * tractors
    return FleetPlan(saved, PlanRequest(width_m=2.0), EG105, BAR, courses, finish_s, 10.0, ground)


def state(sequence: int, **other: Any) -> dict[str, Any]:
    """A frame of a tractor that stands at the origin of the plan, with what it says of itself otherwise."""
    at = datetime.now(UTC).isoformat(timespec="milliseconds")
    place = {"easting_m": 1000.0, "northing_m": 2000.0, "heading_deg": 0.0, "leg": 0, "leg_m": 0.0}
    motion = {"speed_mps": 0.0, "shuttle": 1, "start": 0, "mode": "stopped", "implement": 0}
    commands = {"speed_command_mps": 0.0, "steering_command_deg": 0.0}
    return {"kind": "state", "id": "t", "sequence": sequence, "time": at} | place | motion | commands | other


def format_small_plan(**scenario: object) -> str:
    """A plan file of two tractors that drive two legs each."""
    request = {"field": "mine", "tractor": "eg105", "width_m": 2.0} | scenario
    return format_plan(fleet_plan(2, 2).plan, crs=None, origin_m=(1000.0, 2000.0), scenario=request)


def restart_manager(manager: FleetManager, ended_s: float, begins_s: float, away_s: float = 0.0) -> FleetManager:
    """A new manager that has read what was stored of another, which was killed `away_s` before by the clock."""
    kept = json.loads(json.dumps(capture_progress(manager, ended_s, 1e9)))
    again = FleetManager(manager.plan, manager.rules)
    restore_progress(again, kept, begins_s, 1e9 + away_s)
    return again


@dataclass
class SimulatedFleet:
    """A centre with simulated tractors: each obeys its orders and reports ten times a second."""

    manager: FleetManager
    pace: dict[int, float] = field(default_factory=dict)
    now: float = 0.0
    silent: set[int] = field(default_factory=set)
    standing: list[bool] = field(default_factory=list)
    at_m: list[float] = field(default_factory=list)
    orders: list[TractorOrder] = field(default_factory=list)
    events: list[FleetEvent] = field(default_factory=list)

    def __post_init__(self) -> None:
        count = self.manager.plan.tractor_count
        self.standing, self.at_m = [True] * count, [0.0] * count
        for number in range(count):
            self.manager.connect_tractor(number, self.now)
            self.report(number, 0.0)

    def report(self, number: int, speed: float) -> None:
        """One tractor says where it is."""
        course, at_m = self.manager.plan.timed_missions[number], self.at_m[number]
        leg = min(int(at_m // LENGTH), len(course.legs) - 1)
        work = {"leg": leg, "leg_m": at_m - LENGTH * leg, "implement": int(course.legs[leg].implement)}
        place = course.find_pose(leg, at_m - LENGTH * leg, len(course.legs))
        mode, done = "stopped" if self.standing[number] else "automatic", at_m >= course.leg_starts_m[-1] - 1e-6
        self.manager.take_report(number, TractorReport(*place, speed, speed, mode=mode, done=done, **work), self.now)

    def obey(self) -> None:
        """Take orders."""
        orders, events = self.manager.take_outputs()
        self.orders += orders
        self.events += events
        for order in orders:
            if order.kind in ("stop", "resume"):
                self.standing[order.tractor] = order.kind == "stop"

    def run(self, seconds: float) -> None:
        """Let time pass in steps of a tenth of a second."""
        for _ in range(round(seconds * 10)):
            self.now += 0.1
            self.manager.update_fleet(self.now)
            self.obey()
            for number, state in enumerate(self.manager.states):
                if number in self.silent:
                    continue
                end = self.manager.plan.timed_missions[number].leg_starts_m[state.base_end]
                step = 0.0 if self.standing[number] else 0.1 * SPEED * self.pace.get(number, 1.0)
                step = max(min(step, end - self.at_m[number]), 0.0)
                self.at_m[number] += step
                self.report(number, 10.0 * step)


def start_fleet(plan: FleetPlan | None = None, rules: FleetRules | None = None, **options: object) -> SimulatedFleet:
    """A fleet at the start of its plan, started."""
    fleet = SimulatedFleet(FleetManager(plan or fleet_plan(), rules or FleetRules()), **options)  # type: ignore[arg-type]
    fleet.manager.operators.start_fleet_work("anna", fleet.now)
    fleet.obey()
    return fleet
