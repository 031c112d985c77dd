"""The whole API against its own description: no fault, no status that it does not tell of."""

import os
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest
import schemathesis
from fastapi import FastAPI
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis.errors import Unsatisfiable

from planner.service.settings import ServiceSettings
from tests.service.conftest import SMALL, bearer
from tests.service.one_process import create_app

CONFORM = ("status_code_conformance", "content_type_conformance", "response_schema_conformance")
EXAMPLES = int(os.environ.get("HEADLAND_TEST_EXAMPLES", "4"))
"""What is drawn is the same every time; HEADLAND_TEST_EXAMPLES draws more."""


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FastAPI]:
    """A service with something of everything in it; without workers, so that nothing depends on time."""
    folder = tmp_path_factory.mktemp("contract")
    app = create_app(
        ServiceSettings(data=folder, workers=0, rate_per_minute=10**6, jobs_waiting=10**6), reads_inline=True
    )
    store = app.state.store
    store.add_file("field", "0", SMALL)
    job = store.add_job("plan", "0", {})
    store.claim_job("w")
    store.keep_results(job.number, {"result.json": b"{}"})
    store.finish_job(job.number, "w", {"result.json": b"{}"})
    yield app
    store.close()


@pytest.mark.slow
@pytest.mark.parametrize("part", [0, pytest.param(1, marks=pytest.mark.matrix)])
def test_no_fault_and_no_status_that_is_not_told_of(app: FastAPI, part: int) -> None:
    """Every other operation in each of two parts."""
    described: Any = schemathesis.openapi.from_asgi("/api/v1/openapi.json", app)
    headers, seen = bearer(app, "admin"), 0
    checks = [schemathesis.checks.not_a_server_error, *(getattr(schemathesis.checks, name) for name in CONFORM)]
    for found in [*described.get_all_operations()][part::2]:
        operation = found.ok()
        for mode in schemathesis.GenerationMode:

            @settings(
                max_examples=EXAMPLES, derandomize=True, database=None, deadline=None, phases=(Phase.generate,),
                suppress_health_check=list(HealthCheck),
            )  # fmt: skip
            @given(case=operation.as_strategy(generation_mode=mode))
            def meets(case: Any) -> None:
                nonlocal seen
                seen += 1
                case.call_and_validate(headers=headers, checks=checks)

            with suppress(Unsatisfiable):  # a route without parameters has nothing that could be wrong
                meets()
    assert seen > 100
