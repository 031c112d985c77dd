"""A fleet of one simulated robot that hides an effect from its twin, driven by a clock of its own."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from unittest.mock import patch

from fastapi import FastAPI
from starlette.testclient import TestClient

from planner.service.api import create_app
from planner.service.centre.fleet_plan import FleetPlan
from planner.service.centre.rules import Rules
from planner.service.links import frames
from planner.service.links.clients import TRACTOR, Client
from planner.service.links.live import LiveFleet
from planner.service.robot.driver import Driver
from planner.service.settings import Settings

FRAME_S = 0.1


class Doubting:
    """A service without workers or a network, and its only fleet: frames go by hand, time as `drive` lets it."""

    def __init__(self, data: Path, plan: FleetPlan, hidden: Mapping[str, float], noise_m: float) -> None:
        self.app: FastAPI = create_app(Settings(data=data, workers=0), inline=True)
        self.store, self.hub = self.app.state.store, self.app.state.hub
        self.begin_s, self.now = time.time(), 0.0
        self.store.save_fleet("f1", "field", "{}", {"begin_s": self.begin_s, "times": 1.0, "way": "predict"})
        self.live = LiveFleet("f1", "field", plan, Rules(), begin_s=self.begin_s)
        self.hub.add(self.live)
        self.client = TestClient(self.app, base_url="http://127.0.0.1", client=("127.0.0.1", 4000))
        self.client.headers["authorization"] = f"Bearer {self.store.new_token('anna', 'control')}"
        self.robot = Driver(plan.plan.missions[0], plan.tractor, plan.implement, plan.saved.origin_m, name="robot 1",
                            hidden=hidden, noise_m=noise_m, seed=3)  # fmt: skip
        self.link = Client(TRACTOR, "tractor 1", 0)
        with self._clock():
            self.live.join(self.link, self.now)
            self.robot.step(self.now)
            self.robot.stepper.released = len(plan.courses[0].legs)
            self.robot.stepper.automatic()
            self.live.centre.start("anna", self.now)

    def _clock(self) -> AbstractContextManager[object]:
        return patch("time.time", lambda: self.begin_s + self.now)

    def drive(self, seconds: float) -> None:
        """The robot drives and reports, the fleet steps and keeps, and its doubts are looked at once a second."""
        end = self.now + seconds
        with self._clock():
            while self.now < end and not self.robot.stepper.state.done:
                for _ in range(10):
                    self.now += FRAME_S
                    self.robot.heard({"kind": "beat", "time": ""}, self.now)
                    state = frames.State.model_validate_json(self.told())
                    self.live.reported(self.link, state, self.now)
                    self.live.step(self.now)
                asyncio.run(self.look())

    def told(self) -> str:
        """The robot's next frame."""
        return json.dumps(self.robot.step(self.now))

    async def look(self) -> None:
        """What the hub does once a second."""
        await self.hub.keep(self.live)
        await self.app.state.diagnosing.look(self.live, self.now)

    def alarms(self) -> list[str]:
        """The sentences of alarms that are on."""
        return [one["sentence"] for one in self.live.centre.alarms.told() if not one["over"]]

    def close(self) -> None:
        """End it."""
        self.app.state.reader.close()
        self.store.close()
