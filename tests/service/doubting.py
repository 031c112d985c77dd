"""A fleet of one simulated robot that hides an effect from its twin, driven by a clock of its own."""

import asyncio
import json
import time
from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from unittest.mock import patch

from fastapi import FastAPI
from starlette.testclient import TestClient

from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.rules import FleetRules
from planner.fleet.session import inbound_frames
from planner.fleet.session.clients import TRACTOR, FleetClient
from planner.fleet.session.fleet_session import FleetSession
from planner.fleet.simulated_robot import RobotDriver
from planner.service.api.apps import create_app
from planner.service.settings import ServiceSettings

FRAME_S = 0.1


class DoubtedFleet:
    """A service without workers or a network, and its only fleet: frames go by hand, time as `drive` lets it."""

    def __init__(self, data: Path, plan: FleetPlan, hidden: Mapping[str, float], noise_m: float) -> None:
        self.app: FastAPI = create_app(ServiceSettings(data=data, workers=0), reads_inline=True)
        self.store, self.hub = self.app.state.store, self.app.state.hub
        self.begin_s, self.now = time.time(), 0.0
        self.store.save_fleet("f1", "field", "{}", {"begin_s": self.begin_s, "times": 1.0, "way": "predict"})
        self.live = FleetSession("f1", "field", plan, FleetRules(), begin_s=self.begin_s)
        self.hub.add(self.live)
        self.client = TestClient(self.app, base_url="http://127.0.0.1", client=("127.0.0.1", 4000))
        self.client.headers["authorization"] = f"Bearer {self.store.create_token_text('anna', 'operator')}"
        self.robot = RobotDriver(
            plan.plan.missions[0],
            plan.tractor,
            plan.implement,
            plan.saved.origin_m,
            name="robot 1",
            hidden=hidden,
            noise_m=noise_m,
            seed=3,
        )
        self.link = FleetClient(TRACTOR, "tractor 1", 0)
        with self._clock():
            self.live.add_client(self.link, self.now)
            self.robot.step(self.now)
            self.robot.stepper.base_legs = len(plan.timed_missions[0].legs)
            self.robot.stepper.drive_automatically()
            self.live.manager.operators.start_fleet_work("anna", self.now)

    def _clock(self) -> AbstractContextManager[object]:
        return patch("time.time", lambda: self.begin_s + self.now)

    def drive(self, seconds: float) -> None:
        """The robot drives and reports, the fleet steps and keeps, and its doubts are looked at once a second."""
        end = self.now + seconds
        with self._clock():
            while self.now < end and not self.robot.stepper.state.done:
                for _ in range(10):
                    self.now += FRAME_S
                    self.robot.handle_frame({"kind": "heartbeat", "time": ""}, self.now)
                    state = inbound_frames.StateFrame.model_validate_json(self.told())
                    self.live.take_state(self.link, state, self.now)
                    self.live.step(self.now)
                asyncio.run(self.look())

    def told(self) -> str:
        """The robot's next frame."""
        return json.dumps(self.robot.step(self.now))

    async def look(self) -> None:
        """What the hub does once a second."""
        await self.hub.save(self.live)
        await self.app.state.diagnosing.follow_up(self.live, self.now)

    def alarms(self) -> list[str]:
        """The sentences of alarms that are on."""
        return [one["sentence"] for one in self.live.manager.alarms.describe_alarms() if not one["over"]]

    def close(self) -> None:
        """End it."""
        self.app.state.reader.close()
        self.store.close()
