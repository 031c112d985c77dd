"""From a twin's doubt to the finding and into the tractor file, without anybody having asked for the diagnosis.

The fleet has one simulated robot that hides an effect from its twin, driven by a clock of its own.
"""

import asyncio
import json
import time
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.rules import FleetRules
from planner.fleet.session import inbound_frames
from planner.fleet.session.clients import TRACTOR, FleetClient
from planner.fleet.session.fleet_session import FleetSession
from planner.fleet.session.state_recorder import average_commands
from planner.fleet.simulated_robot import RobotDriver
from planner.service.fleets import twin_routes
from planner.service.jobs.job_runs import build_result_file
from planner.service.settings import ServiceSettings
from tests.service.fleets import EG105, fleet_plan
from tests.service.one_process import create_app
from vehicle.model.tractor import Tractor
from vehicle.model.tractor_writer import format_tractor_toml
from vehicle.twin.step_motion import TractorNoise

VERDICT = "The tractor drives 10 % slower over ground than commanded."
TWIN = "/api/v1/twins/f1/1"

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
        machine, origin_m = (plan.tractor, plan.implement), plan.saved.origin_m
        options: dict[str, Any] = {"name": "robot 1", "hidden": hidden, "noise_m": noise_m, "seed": 3}
        self.robot = RobotDriver(plan.plan.missions[0], *machine, origin_m, **options)
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


@pytest.fixture
def fleet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[DoubtedFleet]:
    monkeypatch.setattr(twin_routes, "DIAGNOSE_AFTER_S", 2.0)
    made = DoubtedFleet(tmp_path, fleet_plan(1, 2), {"wheel_slip": 0.1}, TractorNoise().position_m)
    yield made
    made.close()


def find(fleet: DoubtedFleet, verdict: str, named: list[str], tractor: Tractor | None = None) -> str:
    """Finish the waiting diagnosis with a verdict, and with a tractor file if it makes one; the ID of its job."""
    job = fleet.store.claim_job("test")
    assert job is not None
    results = [build_result_file("result.json", json.dumps({"verdict": verdict, "named": named}))]
    if tractor is not None:
        results.append(build_result_file("tractor.toml", format_tractor_toml(tractor)))
    fleet.store.finish_job(job.number, "test", results)
    asyncio.run(fleet.look())
    return job.id


@pytest.mark.slow
def test_a_doubt_is_diagnosed_once_shown_and_taken_into_the_file(fleet: DoubtedFleet) -> None:
    assert fleet.client.post(f"{TWIN}/mend", json={}).status_code == 409
    fleet.drive(12.0)
    first = fleet.live.diagnoses[0]
    assert fleet.client.get(TWIN).json()["diagnosis"]["status"] == "queued"
    fleet.drive(3.0)
    assert fleet.live.diagnoses[0] == first  # the doubt lasts, and was diagnosed
    mended = Tractor(**EG105.model_dump() | {"name": "slips", "effects": {"wheel_slip": {"value": {"ratio": 0.1}}}})
    assert find(fleet, VERDICT, ["wheel_slip"], mended) == first and fleet.store.claim_job("test") is None
    assert f"Diagnosis of tractor 1: {VERDICT}" in fleet.alarms()
    found = {"named": ["wheel_slip"], "words": VERDICT, "extends_model": True}
    assert fleet.client.get(TWIN).json()["finding"] == found
    taken = fleet.client.post(f"{TWIN}/mend", json={"name": "mine"})
    assert taken.status_code == 201 and taken.json() == {"tractor": "mine"}
    assert b"slips" in fleet.store.blobs.read_bytes(fleet.store.get_file("tractor", "mine").sha256)
    assert fleet.live.twins.tractors[0].name == "slips" and not any("Diagnosis" in one for one in fleet.alarms())
    assert fleet.client.get(TWIN).json()["finding"]["extends_model"] is False
    again = fleet.client.post(f"{TWIN}/mend", json={})
    assert again.status_code == 409 and "nothing that its file lacks" in again.json()["error"]


@pytest.mark.parametrize(
    ("verdict", "named", "tractor", "refusal"),
    [
        ("Nothing.", [], EG105.model_copy(update={"name": "another name"}), "nothing that its file lacks"),
        ("It slips.", ["wheel_slip"], None, "does not lower the error of driving"),
    ],
    ids=["finds nothing", "harms unseen driving"],
)
def test_a_diagnosis_that_finds_nothing_or_harms_unseen_driving_leaves_the_file_as_it_is(
    fleet: DoubtedFleet, verdict: str, named: list[str], tractor: Tractor | None, refusal: str
) -> None:
    fleet.drive(1.0)
    fleet.client.post(f"{TWIN}/diagnose")
    find(fleet, verdict, named, tractor)
    told = fleet.client.get(TWIN).json()["finding"]
    assert told == {"named": named, "words": verdict, "extends_model": False}
    taken = fleet.client.post(f"{TWIN}/mend", json={})
    assert taken.status_code == 409 and refusal in taken.json()["error"]
    assert fleet.live.twins.tractors[0] == EG105


def test_an_operator_asks_again_and_a_diagnosis_that_fails_says_why(fleet: DoubtedFleet) -> None:
    fleet.drive(1.0)
    asked = fleet.client.post(f"{TWIN}/diagnose")
    assert asked.status_code == 202 and asked.json()["diagnosis"]["status"] == "queued"
    job = fleet.store.claim_job("test")
    assert job is not None
    fleet.store.fail_job(job.number, "test", "The log is too short.")
    asyncio.run(fleet.look())
    assert "Diagnosis of tractor 1: The log is too short." in fleet.alarms()
    assert fleet.client.post(f"{TWIN}/mend", json={}).status_code == 409
    again = fleet.client.post(f"{TWIN}/diagnose").json()
    assert again["diagnosis"]["id"] != job.id and again["finding"] is None


def test_what_is_diagnosed_has_the_commands_that_held_between_frames() -> None:
    def row(sequence: int, time_s: float, speed: float, steering: float, shuttle: int = 1) -> list[Any]:
        return [sequence, time_s, 1.0, 2.0, 0.0, 0.0, speed, steering, None, shuttle, 0, 0, 0.0, "automatic"]

    rows = [row(0, 0.0, 1.0, 2.0), row(1, 0.1, 1.4, 4.0), row(2, 0.2, 1.4, 0.0, -1)]
    rows += [row(3, 0.3, 1.0, 1.0, -1), row(4, 5.0, 0.0, 9.0, -1)]
    held = [each[6:8] for each in average_commands(rows)]
    assert held == [[1.2, 3.0], [1.4, 4.0], [1.2, 0.5], [1.0, 1.0], [0.0, 9.0]]
    assert rows[0][6:8] == [1.0, 2.0]
