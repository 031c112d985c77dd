"""From a twin's doubt to the finding and into the tractor file, without anybody having asked for the diagnosis."""

import asyncio
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from planner.fleet.session.state_recorder import average_commands
from planner.service.fleets import twin_routes
from planner.service.jobs.job_runs import build_result_file
from tests.service.doubting import DoubtedFleet
from tests.service.fleets import EG105, fleet_plan
from vehicle.model.tractor import Tractor
from vehicle.model.tractor_writer import format_tractor_toml
from vehicle.twin.step_motion import TractorNoise

VERDICT = "The tractor drives 10 % slower over ground than commanded."
TWIN = "/api/v1/twins/f1/1"


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


def test_a_diagnosis_that_finds_nothing_leaves_the_file_as_it_is(fleet: DoubtedFleet) -> None:
    fleet.drive(1.0)
    fleet.client.post(f"{TWIN}/diagnose")
    find(fleet, "Nothing.", [], EG105.model_copy(update={"name": "another name"}))
    assert fleet.client.get(TWIN).json()["finding"] == {"named": [], "words": "Nothing.", "extends_model": False}
    assert fleet.client.post(f"{TWIN}/mend", json={}).status_code == 409
    assert fleet.live.twins.tractors[0] == EG105


def test_a_diagnosis_that_harms_unseen_driving_offers_no_file(fleet: DoubtedFleet) -> None:
    fleet.drive(1.0)
    fleet.client.post(f"{TWIN}/diagnose")
    find(fleet, "It slips.", ["wheel_slip"])
    told = fleet.client.get(TWIN).json()["finding"]
    assert told == {"named": ["wheel_slip"], "words": "It slips.", "extends_model": False}
    taken = fleet.client.post(f"{TWIN}/mend", json={})
    assert taken.status_code == 409 and "does not lower the error of driving" in taken.json()["error"]


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

    rows = [
        row(0, 0.0, 1.0, 2.0),
        row(1, 0.1, 1.4, 4.0),
        row(2, 0.2, 1.4, 0.0, -1),
        row(3, 0.3, 1.0, 1.0, -1),
        row(4, 5.0, 0.0, 9.0, -1),
    ]
    held = [each[6:8] for each in average_commands(rows)]
    assert held == [[1.2, 3.0], [1.4, 4.0], [1.2, 0.5], [1.0, 1.0], [0.0, 9.0]]
    assert rows[0][6:8] == [1.0, 2.0]
