"""What twins add to the centre: places for the forecast, paths for the watch; and the chance to keep the deadline.

From a twin's doubt to the finding and into the tractor file nobody asks for the diagnosis: a fleet has one simulated
robot that hides an effect from its twin, driven by a clock of its own.
"""

import asyncio
import json
import math
import time
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from fastapi import FastAPI
from hypothesis import given
from hypothesis import strategies as st
from starlette.testclient import TestClient

from fields.arrays import Floats
from planner.fleet.manager.finish_forecast import FinishDistribution, read_finish_distribution
from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.rules import FleetRules
from planner.fleet.model.tractor_state import Hold
from planner.fleet.session import inbound_frames
from planner.fleet.session.clients import TRACTOR, FleetClient
from planner.fleet.session.fleet_session import FleetSession
from planner.fleet.session.frame_content import build_tick_fleet
from planner.fleet.session.state_recorder import average_commands
from planner.fleet.simulated_robot import RobotDriver
from planner.service.fleets import twin_routes
from planner.service.settings import ServiceSettings
from tests.service.fleets import EG105, SimulatedFleet, fleet_plan, start_fleet
from tests.service.one_process import create_app
from vehicle.model.tractor import Tractor
from vehicle.model.tractor_writer import format_tractor_toml
from vehicle.twin.step_motion import TractorNoise

WHOLE = FinishDistribution(planned_s=1000.0, p50_s=1100.0, p80_s=1200.0, p95_s=1400.0)
VERDICT = "The tractor drives 10 % slower over ground than commanded."
TWIN = "/api/v1/twins/f1/1"
FRAME_S = 0.1


class FixedTwins:
    """Twins of which a test says where they are and will be."""

    def __init__(self) -> None:
        self.places: dict[int, tuple[float, float]] = {}
        self.paths: dict[int, Floats] = {}

    def find_place(self, number: int) -> tuple[float, float] | None:
        return self.places.get(number)

    def predict_path(self, number: int, times_s: Floats) -> Floats | None:
        return self.paths.get(number)


def watched(apart_m: float = 20.0) -> tuple[SimulatedFleet, FixedTwins]:
    twins = FixedTwins()
    fleet = SimulatedFleet(FleetManager(fleet_plan(apart_m=apart_m), FleetRules(), twins))
    fleet.manager.operators.start_fleet_work("anna", 0.0)
    fleet.obey()
    return fleet, twins


def test_the_forecast_begins_where_the_twin_is_by_now() -> None:
    fleet, twins = watched()
    fleet.run(18.0)
    fleet.silent.add(0)  # no more is heard of it, and its twin drives on
    fleet.manager.twins = twins
    before = fleet.manager.states[0].leg_m
    twins.places[0] = (0.0, before + 4.0)
    fleet.run(1.0)
    left_m = 60.0 - before - 4.0
    assert fleet.manager.finish_in_s[0] == pytest.approx(left_m, abs=0.6)
    twins.places[0] = (0.0, before - 3.0)  # behind what it has reported itself
    fleet.run(1.0)
    assert fleet.manager.finish_in_s[0] == pytest.approx(60.0 - before, abs=0.6)


def test_a_place_on_the_next_leg_is_of_that_leg_as_far_as_legs_are_released() -> None:
    course = fleet_plan().timed_missions[0]
    assert course.locate_ahead(0, 18.0, 2, (0.1, 21.5)) == (1, pytest.approx(1.5, abs=0.13))
    assert course.locate_ahead(0, 18.0, 1, (0.1, 21.5)) == (1, pytest.approx(0.0))  # the end of what is released
    assert course.locate_ahead(2, 19.0, 3, (0.0, 70.0)) == (2, pytest.approx(20.0))


@pytest.mark.parametrize("towards, stopped", [(True, True), (False, False)])
def test_who_drives_by_hand_is_foreseen_by_the_twin(towards: bool, stopped: bool) -> None:
    fleet, twins = watched(apart_m=6.0)
    manager = fleet.manager
    fleet.run(5.0)
    one = manager.states[0]
    assert one.report is not None
    one.holds.add(Hold.REMOTE_CONTROL)
    one.report = one.report._replace(mode="remote", speed_mps=1.0)  # straight ahead, and the twin knows better
    x, y = one.report.x_m, one.report.y_m
    steps = np.linspace(0.0, 1.0, 11)
    aside = 6.0 * steps if towards else 0.0 * steps
    twins.paths[0] = np.column_stack([x + aside, y + 5.0 * steps, np.full(11, 0.5 * math.pi)])
    dangers = manager.guard.find_dangers(manager.states)
    assert bool([each for each in dangers if (each.first, each.second) == (0, 1)]) is stopped


def test_chances_of_the_whole_are_those_of_the_draws() -> None:
    for left_s, share in ((1100.0, 0.5), (1200.0, 0.8), (1400.0, 0.95)):
        assert WHOLE.compute_probability(1000.0, left_s) == pytest.approx(share, abs=1e-3)
    assert WHOLE.compute_probability(math.inf, 100.0) is None
    assert (WHOLE.compute_probability(0.0, 1.0), WHOLE.compute_probability(0.0, -1.0)) == (1.0, 0.0)
    sure = FinishDistribution(1000.0, 1000.0, 1000.0, 1000.0)
    assert (sure.compute_probability(500.0, 501.0), sure.compute_probability(500.0, 499.0)) == (1.0, 0.0)


@given(st.floats(0.0, 2000.0), st.floats(-100.0, 3000.0), st.floats(0.0, 500.0))
def test_more_time_never_makes_it_less_likely_nor_less_work(rest_s: float, left_s: float, more_s: float) -> None:
    base = WHOLE.compute_probability(rest_s, left_s)
    later = WHOLE.compute_probability(rest_s, left_s + more_s)
    assert base is not None and later is not None and 0.0 <= base <= later <= 1.0


def test_chances_are_those_of_the_plan_that_is_driven() -> None:
    one = {"strategy": "circuit", "tractors": 2, "time_s": 10.0, "p50_s": 11.0, "p80_s": 12.0, "p95_s": 13.0}
    other = one | {"strategy": "split-field", "p95_s": None}
    result = {"best": one, "plans": [one, other]}
    assert read_finish_distribution(result, "plan.json") == FinishDistribution(10.0, 11.0, 12.0, 13.0)
    assert read_finish_distribution(result, "plan-circuit-2.json") == FinishDistribution(10.0, 11.0, 12.0, 13.0)
    assert read_finish_distribution(result, "plan-split-field-2.json") is None  # made without draws
    assert read_finish_distribution({"best": None, "plans": []}, "plan.json") is None


def test_a_tick_tells_the_probability_where_there_are_draws_and_a_deadline() -> None:
    fleet = start_fleet()
    assert build_tick_fleet(fleet.manager, 65.0, WHOLE)["probability"] is None  # nobody knows how long it takes yet
    fleet.run(5.0)
    drawn = FinishDistribution(60.0, 60.0, 66.0, 72.0)
    told = build_tick_fleet(fleet.manager, 60.0, drawn)
    assert 0.5 < told["probability"] < build_tick_fleet(fleet.manager, 65.0, drawn)["probability"] < 1.0
    assert build_tick_fleet(fleet.manager, None, drawn)["probability"] is None
    assert build_tick_fleet(fleet.manager, 60.0, None)["probability"] is None


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
    results = {"result.json": json.dumps({"verdict": verdict, "named": named}).encode()}
    if tractor is not None:
        results["tractor.toml"] = format_tractor_toml(tractor).encode()
    fleet.store.keep_results(job.number, results)
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
