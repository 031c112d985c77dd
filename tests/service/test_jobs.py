"""Workers: what becomes of a job that is done, refused, broken, cancelled, or takes its process with it."""

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from planner.service.jobs.supervisor import Supervisor
from planner.service.jobs.worker import do_job
from planner.service.settings import Settings
from planner.service.store import Store
from tests.benchmarks.jobs import campaign
from tests.service.databases import database
from tests.service.kinds import KINDS, made


@pytest.fixture
def kept(tmp_path: Path) -> Store:
    """A store that knows the kinds of these tests."""
    return Store(Settings(data=tmp_path / "data", workers=1, kinds=KINDS, lease_s=1.0))


def done_here(store: Store, kind: str, **request: object) -> str:
    """Do one job in this process; its ID."""
    job = store.add_job(kind, "here", {"number": 7, **request}, {"field/x": store.blobs.put(b"X")})
    claimed = store.claim_job("here")
    assert claimed is not None
    do_job(store, "here", claimed)
    return job.id


def test_a_job_finds_its_files_and_leaves_its_results(kept: Store) -> None:
    before = Path.cwd()
    done = kept.job(done_here(kept, "tiny", files=["field/x"]))
    assert (done.status, done.words, Path.cwd()) == ("done", "At work", before)
    assert kept.blobs.get(done.results[0].sha256) == made(7, b"X")[0][1]
    assert list((kept.settings.data / "work").iterdir()) == []


def test_a_job_that_fails_says_why_in_one_sentence(kept: Store) -> None:
    refused, broken = kept.job(done_here(kept, "refused")), kept.job(done_here(kept, "broken"))
    assert (refused.status, refused.error) == ("failed", "width is 7; use another.")
    assert (broken.status, broken.error) == (
        "failed", "A fault of Headland (RuntimeError: something else); please report it."
    )  # fmt: skip


def until(true: Callable[[], bool], patience_s: float = 60.0) -> None:
    """Wait for something."""
    end = time.monotonic() + patience_s
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_workers_are_replaced_and_end_with_their_supervisor(kept: Store) -> None:
    settings = replace(kept.settings, tries=2)
    store = Store(settings)
    supervisor = Supervisor(settings, store)
    supervisor.start()
    try:
        deadly, long = store.add_job("deadly", "deadly", {}), store.add_job("tiny", "long", {"number": 1, "step_s": 30})
        until(lambda: store.job(long.id).status == "running")
        until(lambda: store.job(long.id).words == "At work")
        first = supervisor.pids()
        store.cancel_job(long.id)
        last = store.add_job("tiny", "last", {"number": 2})
        until(lambda: store.job(last.id).status == "done" and store.job(deadly.id).status == "failed")
        assert supervisor.pids() != first and store.job(long.id).status == "cancelled"
        assert "ended 2 times" in str(store.job(deadly.id).error)
        left = store.add_job("tiny", "left", {"number": 3, "step_s": 30})
        until(lambda: store.job(left.id).status == "running")
        pids = supervisor.pids()
    finally:
        supervisor.stop()
    assert (store.job(left.id).status, store.job(left.id).tries) == ("queued", 0)
    assert pids and supervisor.pids() == []
    store.close()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes are found in /proc")
@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_jobs_are_done_once_though_server_and_workers_are_killed(kind: str, tmp_path: Path) -> None:
    with database(kind) as url:
        settings = Settings(data=tmp_path / "data", database=url, workers=1, lease_s=2.0)
        found = campaign(settings, jobs=20, kills=3, seed=3, whole=False, patience_s=120.0)
    assert (found.done, found.wrong, found.left_over) == (20, [], [])
    assert found.servers_killed >= 1 and found.servers_killed + found.workers_killed == 3
