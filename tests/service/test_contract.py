"""The whole API against its own description: no fault, no status that it does not tell of."""

import os
from collections.abc import Iterator

import pytest
import schemathesis
from fastapi import FastAPI
from hypothesis import HealthCheck, given, settings
from schemathesis import Case

from planner.service.api import create_app
from planner.service.settings import Settings
from tests.service.conftest import SMALL, bearer

EXAMPLES = int(os.environ.get("HEADLAND_TEST_EXAMPLES", "12"))
CHECKS = (
    schemathesis.checks.not_a_server_error,
    schemathesis.checks.status_code_conformance,
    schemathesis.checks.content_type_conformance,
    schemathesis.checks.response_schema_conformance,
)


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FastAPI]:
    """A service with something of everything in it; without workers, so that nothing depends on time."""
    folder = tmp_path_factory.mktemp("contract")
    app = create_app(Settings(data=folder, workers=0, rate_per_minute=10**6, jobs_waiting=10**6), inline=True)
    store = app.state.store
    store.add_file("field", "0", SMALL)
    job = store.add_job("plan", "0", {})
    store.claim_job("w")
    store.finish_job(job.number, "w", [("result.json", b"{}", "application/json")])
    yield app
    store.close()
