"""A client generated from the OpenAPI of the service: fields, a plan, its progress and its results."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from pydantic import ValidationError

from planner.service.api.apps import create_app
from planner.service.jobs.workers import run_and_store_job
from planner.service.settings import ServiceSettings
from planner.service.store.service_store import Store
from tests.service.conftest import BOTH, SMALL, bearer, client_of
from tests.service.typed_client import generate_client

USED = """
from service_client import Client
from service_models import PlanJobRequest

def plan(client: Client) -> str:
    fields = client.list_fields().items
    job = client.ask_plan(PlanJobRequest(field=fields[0].name, tractors="1"))
    return client.watch_plan(job.id).status{wrong}
"""


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[ModuleType, Any, Store, Path]]:
    """The generated module, a client of it on a service without workers, the store, and where the module is."""
    settings = ServiceSettings(data=tmp_path_factory.mktemp("data"), workers=0)
    app = create_app(settings, reads_inline=True)
    folder = tmp_path_factory.mktemp("client")
    module = generate_client(app.openapi(), folder)
    with client_of(app) as http:
        yield module, module.Client(http, bearer(app, BOTH)), app.state.store, folder


@pytest.mark.slow
def test_every_operation_has_a_method(service: tuple[ModuleType, Any, Store, Path]) -> None:
    _, client, _, folder = service
    source = (folder / "service_client.py").read_text(encoding="utf-8")
    named = {"list_fields", "upload_field", "ask_plan", "watch_plan", "download_plan_result", "list_jobs", "ask_day"}
    assert {name for name in named if callable(getattr(client, name, None))} == named
    assert "def ask_plan(self, body: models.PlanJobRequest) -> models.JobInfo:" in source


@pytest.mark.slow
def test_a_program_plans_a_field_and_fetches_the_result(service: tuple[ModuleType, Any, Store, Path]) -> None:
    module, client, store, _ = service
    uploaded = client.upload_field(("north.geojson", SMALL, "application/geo+json"))
    assert uploaded.name in [one.name for one in client.list_fields().items]
    request = module.models.PlanJobRequest(
        field=uploaded.name, local=True, tractors="1", strategies="split-field", width=6.0
    )
    job = client.ask_plan(request)
    assert client.watch_plan(job.id).status == "queued"
    claimed = store.claim_job("w")
    assert claimed is not None
    run_and_store_job(store, "w", claimed)
    done = client.watch_plan(job.id)
    assert done.status == "done" and "result.json" in done.results
    answer = json.loads(client.download_plan_result(job.id, "result.json"))
    assert answer["best"]["strategy"] == "split-field" and answer["best"]["worked_pct"] > 80.0
    assert job.id in [one.id for one in client.list_plan_jobs().items]


def test_refusals_come_with_their_sentence(service: tuple[ModuleType, Any, Store, Path]) -> None:
    module, client, _, _ = service
    with pytest.raises(module.Refused, match="422") as refusal:
        client.ask_plan(module.models.PlanJobRequest(tractors="3-1"))
    assert refusal.value.error["parameter"] == "tractors"
    with pytest.raises(module.Refused, match="404"):
        client.watch_plan("../fields")
    with pytest.raises(ValidationError, match="widht"):
        module.models.PlanJobRequest(widht=3)


@pytest.mark.slow
@pytest.mark.parametrize(("wrong", "status"), [("", 0), (".colour", 1)])
def test_the_client_is_typed(service: tuple[ModuleType, Any, Store, Path], wrong: str, status: int) -> None:
    pytest.importorskip("mypy", reason="types are checked with mypy")
    folder = service[-1]
    (folder / "used.py").write_text(USED.format(wrong=wrong), encoding="utf-8")
    types = str(folder / "types")
    words = [sys.executable, "-m", "mypy", "--strict", "--config-file=", "--cache-dir", types, "used.py"]
    checked = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=240, check=False)
    assert checked.returncode == status, checked.stdout
    assert ("has no attribute" in checked.stdout) == bool(wrong)
