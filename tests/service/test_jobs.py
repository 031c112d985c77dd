"""Workers: what becomes of a job that is done, refused, broken, cancelled, or takes its process with it."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from planner.service.jobs.workers import WorkerSupervisor, run_and_store_job
from planner.service.settings import ServiceSettings
from planner.service.store.service_store import Store
from tests.benchmarks.jobs import campaign
from tests.service.conftest import wait_until
from tests.service.databases import database
from tests.service.kinds import KINDS, made


@pytest.fixture
def kept(tmp_path: Path) -> Store:
    """A store that knows the kinds of these tests."""
    return Store(ServiceSettings(data=tmp_path / "data", workers=1, job_functions=KINDS, lease_s=1.0))


def done_here(store: Store, kind: str, **request: object) -> str:
    """Do one job in this process; its ID."""
    job = store.add_job(kind, "here", {"number": 7, **request}, {"field/x": store.blobs.put_bytes(b"X")})
    claimed = store.claim_job("here")
    assert claimed is not None
    run_and_store_job(store, "here", claimed)
    return job.id


def test_a_job_finds_its_files_and_leaves_its_results(kept: Store) -> None:
    before = Path.cwd()
    done = kept.get_job(done_here(kept, "tiny", files=["field/x"]))
    assert (done.status, done.words, Path.cwd()) == ("done", "At work", before)
    assert kept.blobs.read_bytes(done.results[0].sha256) == made(7, b"X")[0][1]
    assert list((kept.settings.data / "work").iterdir()) == []


def test_a_job_that_fails_says_why_in_one_sentence(kept: Store) -> None:
    refused, broken = kept.get_job(done_here(kept, "refused")), kept.get_job(done_here(kept, "broken"))
    assert (refused.status, refused.error) == ("failed", "width is 7; use another.")
    assert (broken.status, broken.error) == (
        "failed", "This is a fault of Headland (RuntimeError: something else); please report it."
    )  # fmt: skip


@pytest.mark.slow
def test_workers_are_replaced_and_end_with_their_supervisor(kept: Store) -> None:
    settings = replace(kept.settings, tries=2)
    store = Store(settings)
    supervisor = WorkerSupervisor(settings, store)
    supervisor.start()
    try:
        deadly, long = store.add_job("deadly", "deadly", {}), store.add_job("tiny", "long", {"number": 1, "step_s": 30})
        wait_until(lambda: store.get_job(long.id).status == "running")
        wait_until(lambda: store.get_job(long.id).words == "At work")
        first = supervisor.list_worker_pids()
        store.cancel_job(long.id)
        last = store.add_job("tiny", "last", {"number": 2})
        wait_until(lambda: store.get_job(last.id).status == "done" and store.get_job(deadly.id).status == "failed")
        assert supervisor.list_worker_pids() != first and store.get_job(long.id).status == "cancelled"
        assert "ended 2 times" in str(store.get_job(deadly.id).error)
        left = store.add_job("tiny", "left", {"number": 3, "step_s": 30})
        wait_until(lambda: store.get_job(left.id).status == "running")
        pids = supervisor.list_worker_pids()
    finally:
        supervisor.stop()
    assert (store.get_job(left.id).status, store.get_job(left.id).tries) == ("queued", 0)
    assert pids and supervisor.list_worker_pids() == []
    store.close()


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes are found in /proc")
@pytest.mark.parametrize("kind", [pytest.param("sqlite", marks=pytest.mark.matrix), "postgresql"])
def test_jobs_are_done_once_though_server_and_workers_are_killed(kind: str, tmp_path: Path) -> None:
    with database(kind) as url:
        settings = ServiceSettings(data=tmp_path / "data", database=url, workers=1, lease_s=2.0)
        found = campaign(settings, jobs=20, kills=3, seed=3, whole=False, patience_s=120.0)
    assert (found.done, found.wrong, found.left_over) == (20, [], [])
    assert found.servers_killed >= 1 and found.servers_killed + found.workers_killed == 3
