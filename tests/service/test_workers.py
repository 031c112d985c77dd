"""Workers on other machines: whose turn it is, bytes on their way, leases, versions, and the command."""

import os
import random
import re
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
import sqlalchemy as sa
import typer
import yaml

from planner.cli import main
from planner.service.errors import BusyError, DatabaseError, NotFoundError, ResultPlaceError, VersionError
from planner.service.jobs import job_runs, workers
from planner.service.jobs.workers import WorkerSupervisor, run_and_store_job
from planner.service.kept_process import LOOK_PERIOD_S
from planner.service.settings import ServiceSettings
from planner.service.store.carried_bytes import ResultPlace, check_result_place
from planner.service.store.job_queue import RemoteStore
from planner.service.store.service_store import Store
from planner.service.store.tables import JobBytesRow, JobRow, Owner, WriteCheckRow
from tests.benchmarks.jobs import campaign
from tests.service.conftest import run_next_job, wait_until
from tests.service.databases import database
from tests.service.earlier import make
from tests.service.kinds import KINDS, made
from tests.service.test_commands import COMMAND
from tests.service.web_proxies import GUIDE

ROOT = Path(__file__).parents[2]
OWNERS = {name: None if name == "nobody" else Owner(name, name) for name in ("nobody", "ann", "bob", "eve")}


@pytest.fixture
def shared(tmp_path: Path) -> Iterator[Store]:
    """The store of a service on PostgreSQL without workers of its own."""
    with database("postgresql") as url:
        store = Store(ServiceSettings(data=tmp_path / "data", database=url, workers=0, lease_s=1.0))
        store.check_write()
        yield store
        store.close()


@pytest.fixture
def remote(shared: Store, tmp_path: Path) -> Iterator[RemoteStore]:
    """The same jobs as a worker elsewhere sees them."""
    store = RemoteStore(replace(shared.settings, data=tmp_path / "elsewhere", workers=1, job_functions=KINDS))
    yield store
    store.close()


def set_version(store: Store, version: str) -> None:
    """Let the service be of a version."""
    with store.database.open_write_session() as session:
        session.execute(sa.update(WriteCheckRow).values(version=version))


def count_carried(store: Store) -> int:
    """Bytes that are under way."""
    with store.database.open_read_session() as session:
        return session.scalar(sa.select(sa.func.count()).select_from(JobBytesRow)) or 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_nobody_waits_while_two_jobs_of_another_are_begun(store: Store, seed: int) -> None:
    draw, waiting = random.Random(seed), Counter[str]()
    begun_since: dict[str, Counter[str]] = {}
    for step in range(120):
        name = draw.choice(list(OWNERS))
        if draw.random() < 0.4:
            for _ in range(draw.randint(1, 4)):
                store.add_job("plan", f"{name} {step}", {}, owner=OWNERS[name])
                begun_since.setdefault(name, Counter())
                waiting[name] += 1
        elif (job := store.claim_job("w")) is not None:
            who = job.owner or "nobody"
            for each in begun_since.values():
                each[who] += 1
            waiting[who] -= 1
            del begun_since[who]
            if waiting[who]:
                begun_since[who] = Counter()
            assert all(times <= 1 for each in begun_since.values() for times in each.values()), (step, begun_since)
            if draw.random() < 0.3:
                store.release_jobs("w", counts_try=False)
                store.finish_job(job.number, "w", {})
                waiting[who] += 1
                begun_since.setdefault(who, Counter())
            else:
                assert store.finish_job(job.number, "w", {})
        assert (store.claim_job("none") is None) if not +waiting else True


def test_one_who_waits_for_much_holds_up_nobody(store: Store) -> None:
    for number in range(50):
        store.add_job("plan", f"ann {number}", {}, owner=OWNERS["ann"])
    first = store.claim_job("w1")
    theirs = [store.add_job("plan", name, {}, owner=OWNERS[name]) for name in ("bob", "nobody")]
    taken = [store.claim_job(f"w{number}") for number in range(2, 6)]
    assert first is not None and [job.owner for job in taken if job is not None] == ["bob", None, "ann", "ann"]
    assert {job.id for job in taken[:2] if job is not None} == {job.id for job in theirs}


def test_too_many_waiting_jobs_are_refused_to_their_owner_alone(both: ServiceSettings) -> None:
    store = Store(replace(both, jobs_waiting=2))
    for number in range(2):
        store.add_job("plan", f"ann {number}", {}, owner=OWNERS["ann"])
    with pytest.raises(BusyError, match=r"^2 jobs of yours are waiting; .* done\.$") as refusal:
        store.add_job("plan", "one more", {}, owner=OWNERS["ann"])
    assert refusal.value.http_status == 429
    for name in ("bob", "nobody"):
        store.add_job("plan", "first", {}, owner=OWNERS[name])
    assert store.claim_job("w") is not None
    store.add_job("plan", "one more", {}, owner=OWNERS["ann"])
    store.close()


def test_inputs_come_and_results_go_by_the_database(shared: Store, remote: RemoteStore) -> None:
    content = b"X" * 300_000
    sha256 = shared.blobs.put_bytes(content)
    inputs = {"field/x": sha256, "field/y": sha256, "field/gone": "0" * 64}
    job = shared.add_job("tiny", "first", {"number": 7, "files": ["field/x", "field/y"]}, inputs)
    assert count_carried(shared) == 1
    run_next_job(remote)
    assert "are gone" in str(shared.get_job(job.id).error)
    del inputs["field/gone"]
    job = shared.add_job("tiny", "second", {"number": 7, "files": ["field/x", "field/y"]}, inputs)
    run_next_job(remote)
    (result,) = shared.get_job(job.id).results
    wanted = made(7, 2 * content)["result.json"]
    path = shared.blobs.get_path(result.sha256)
    assert shared.blobs.read_bytes(result.sha256) == wanted and not path.exists()
    shared.tend_queue()
    assert count_carried(shared) == 0 and path.read_bytes() == wanted
    assert list((remote.settings.data / "work").iterdir()) == [] and not (remote.settings.data / "bytes").exists()


@pytest.fixture
def bucket(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The address of a folder in a bucket of an S3 of this test's own, as the environment tells fsspec."""
    import boto3
    import fsspec
    from moto.server import ThreadedMotoServer

    server = ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    settings = {"endpoint_url": f"http://{host}:{port}", "key": "farm", "secret": "not secret"}
    monkeypatch.setitem(fsspec.config.conf, "s3", settings)
    names = {"endpoint_url": "endpoint_url", "key": "aws_access_key_id", "secret": "aws_secret_access_key"}
    boto3.client("s3", region_name="us-east-1", **{names[key]: value for key, value in settings.items()}).create_bucket(
        Bucket="results"
    )
    yield "s3://results/farm"
    server.stop()


def run_one_job(shared: Store, remote: RemoteStore, name: str) -> str:
    """Let a worker elsewhere do a job; returns the SHA-256 of its result."""
    job = shared.add_job("tiny", name, {"number": 7})
    run_next_job(remote)
    return shared.get_job(job.id).results[0].sha256


def check_results_by_place(shared: Store, remote: RemoteStore, address: str) -> None:
    """Results that go by a store, that are gone from it, and that the service does not know."""
    check_result_place(replace(shared.settings, results=address))
    shared.place = remote.place = ResultPlace(address)
    with patch.object(ResultPlace, "put_bytes", autospec=True, side_effect=ResultPlace.put_bytes) as put:
        sha256 = run_one_job(shared, remote, "first")
    assert put.call_count == 1, "while the job is reported, and not again when it is finished"
    with shared.database.open_read_session() as session:
        (row,) = session.scalars(sa.select(JobBytesRow))
        assert row.content == b"" and row.address == f"{address}/{row.job}-{sha256}"
    wanted = made(7)["result.json"]
    assert shared.blobs.read_bytes(sha256) == wanted and not shared.blobs.get_path(sha256).exists()
    shared.place = None
    with pytest.raises(ResultPlaceError, match=rf"are in {address}, which this .* start it with --results") as refusal:
        shared.blobs.read_bytes(sha256)
    assert (refusal.value.http_status, refusal.value.status) == (503, 1)
    shared.tend_queue()
    assert count_carried(shared) == 1
    shared.place = ResultPlace(address)
    shared.tend_queue()
    assert count_carried(shared) == 0 and shared.blobs.get_path(sha256).read_bytes() == wanted
    with pytest.raises(NotFoundError, match=r"is gone from its store; compute it again\.$"):
        shared.place.read_bytes(row.address)
    shared.blobs.get_path(sha256).unlink()
    run_one_job(shared, remote, "second")
    with shared.database.open_write_session() as session:
        session.execute(sa.update(JobBytesRow).values(address=f"{address}/nowhere"))
    with pytest.raises(NotFoundError, match="is gone from its store"):
        shared.blobs.read_bytes(sha256)


def test_results_go_by_a_store(shared: Store, remote: RemoteStore, tmp_path: Path) -> None:
    check_results_by_place(shared, remote, (tmp_path / "on" / "the" / "way").as_uri())


@pytest.mark.slow
def test_results_go_by_a_bucket(shared: Store, remote: RemoteStore, bucket: str) -> None:
    check_results_by_place(shared, remote, bucket)
    with pytest.raises(
        ResultPlaceError, match=r"^The store of results s3://other/farm does not answer .* bucket exists"
    ):
        ResultPlace("s3://other/farm").check()


class SlowPlace(ResultPlace):
    """A store that takes its time, also to fail."""

    def put_bytes(self, name: str, content: bytes) -> None:
        time.sleep(1.5)
        super().put_bytes(name, content)


@pytest.mark.slow
def test_a_job_waits_for_a_store_that_does_not_answer(shared: Store, remote: RemoteStore, tmp_path: Path) -> None:
    blocked = tmp_path / "blocked"
    blocked.write_bytes(b"no folder")
    remote.place = SlowPlace(f"{blocked.as_uri()}/results")
    job = shared.add_job("tiny", "first", {"number": 7})
    claimed = remote.claim_job("w")
    assert claimed is not None
    working = threading.Thread(target=run_and_store_job, args=(remote, "w", claimed), daemon=True)
    working.start()
    wait_until(lambda: shared.get_job(job.id).words == ResultPlaceError.waiting)
    told = [shared.get_job(job.id).words for _ in range(40) if not time.sleep(0.1)]
    assert set(told) == {ResultPlaceError.waiting}, "it says so as long as it waits"
    blocked.unlink()
    working.join(30.0)
    assert (shared.get_job(job.id).status, shared.get_job(job.id).tries) == ("done", 1)


def test_inputs_of_a_database_that_was_restored_are_lent_once(shared: Store, remote: RemoteStore) -> None:
    shared.add_job("tiny", "first", {"number": 7}, {"field/x": shared.blobs.put_bytes(b"X")})
    with shared.database.open_write_session() as session:
        session.execute(sa.delete(JobBytesRow))
    for _ in range(2):
        shared.lend_all_inputs()
        assert count_carried(shared) == 1
    assert remote.blobs.read_bytes(shared.list_jobs()[0].inputs["field/x"]) == b"X"


def test_a_job_whose_worker_is_gone_is_done_once_by_another(shared: Store, remote: RemoteStore) -> None:
    job = shared.add_job("tiny", "first", {"number": 7})
    assert remote.claim_job("gone") is not None
    shared.tend_queue()
    assert remote.claim_job("here") is None and remote.report_job(job.number, "gone")
    wait_until(lambda: shared.tend_queue() is None and shared.get_job(job.id).status == "queued", 10.0)
    claimed = remote.claim_job("here")
    assert claimed is not None and claimed.tries == 2
    assert not remote.report_job(job.number, "gone") and not remote.finish_job(job.number, "gone", made(1))
    assert remote.finish_job(job.number, "here", made(7)) and not remote.finish_job(job.number, "here", made(7))
    assert shared.blobs.read_bytes(shared.get_result(job.id, "result.json").sha256) == made(7)["result.json"]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_workers_that_stall_and_race_never_finish_a_job_twice(shared: Store, remote: RemoteStore, seed: int) -> None:
    jobs = [
        shared.add_job("tiny", f"job {number}", {}, owner=OWNERS[name])
        for number in range(8)
        for name in ("ann", "bob", "eve")
    ]
    finished: list[int] = []
    held: set[int] = set()

    def work(name: str) -> None:
        draw = random.Random(f"{seed} {name}")
        while len(finished) < len(jobs):
            job = remote.claim_job(name)
            if job is None:
                shared.release_expired()
                continue
            if draw.random() < 0.2:  # it stalls, and comes back when somebody else may have the job
                with shared.database.open_write_session() as session:
                    session.execute(sa.update(JobRow).where(JobRow.number == job.number).values(lease=0.0, tries=0))
                shared.release_expired()
                time.sleep(0.02 * draw.random())
            else:
                assert job.number not in held
                held.add(job.number)
            if remote.finish_job(job.number, name, made(job.number)):
                finished.append(job.number)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(work, ("w0", "w1", "w2", "w3"), timeout=60.0))
    assert sorted(finished) == [job.number for job in jobs]
    assert Counter(job.status for job in shared.list_jobs()) == {"done": len(jobs)}


def test_only_a_worker_of_the_version_of_the_service_gets_jobs(shared: Store, remote: RemoteStore) -> None:
    shared.add_job("tiny", "first", {})
    set_version(shared, "9.9 with tables 0099")
    assert remote.claim_job("w") is None
    with pytest.raises(VersionError, match=r"^This worker is Headland .* is 9\.9 with .*; install the same") as refusal:
        RemoteStore(remote.settings)
    assert refusal.value.status == 4
    shared.check_write()
    assert remote.claim_job("w") is not None


def test_a_database_that_is_restarted_while_a_worker_begins_is_told_in_a_sentence(
    shared: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lose_connection(_self: RemoteStore) -> None:
        raise sa.exc.OperationalError("SELECT", {}, Exception("terminating connection due to administrator command"))

    monkeypatch.setattr(RemoteStore, "check_version", lose_connection)
    with pytest.raises(DatabaseError, match=r"cannot be used: terminating connection"):
        RemoteStore(shared.settings)


def test_a_database_that_is_none_of_this_version_is_refused(tmp_path: Path) -> None:
    with database("postgresql") as url:
        settings = ServiceSettings(data=tmp_path, database=url)
        with pytest.raises(DatabaseError, match="no tables of Headland yet; begin headland serve"):
            RemoteStore(settings)
        make(settings.url, "0006")
        with pytest.raises(VersionError, match="with tables 0006; install"):
            RemoteStore(settings)


def test_every_command_of_the_compose_file_is_one() -> None:
    compose = yaml.safe_load((GUIDE / "compose.yaml").read_text(encoding="utf-8"))
    services: dict[str, Any] = compose["services"]
    app: Any = typer.main.get_command(main.app)
    assert set(services) == {"database", "service", "worker"} and services["worker"]["deploy"]["replicas"] == 2
    for service in services.values():
        assert set(service.get("depends_on", {})) <= set(services)
        assert {each.split(":")[0] for each in service.get("volumes", ())} <= set(compose["volumes"])
    text = (GUIDE / "compose.yaml").read_text(encoding="utf-8")
    lines = [services[name]["command"] for name in ("service", "worker")]
    lines += [each.split() for each in re.findall(r"docker compose run --rm service (.+)", text)]
    for words in lines:
        command, rest = app, list(words)
        while hasattr(command, "commands"):
            command = command.commands[rest.pop(0)]
        assert command.make_context("headland", rest).params["database"].startswith("postgresql:")
    assert len(lines) == 3


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="SIGTERM ends a process at once on Windows")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_worker_that_is_ended_gives_its_job_back(shared: Store, tmp_path: Path, number: int) -> None:
    job = shared.add_job("tiny", "long", {"number": 7, "step_s": 30})
    words = [str(tmp_path / "elsewhere"), shared.settings.database, "1", "remote"]
    with subprocess.Popen([sys.executable, "-m", "tests.service.serving", *words], cwd=ROOT) as process:
        wait_until(lambda: shared.get_job(job.id).words == "At work")
        process.send_signal(number)
        assert process.wait(20) == 0
    assert (shared.get_job(job.id).status, shared.get_job(job.id).tries) == ("queued", 0)


@pytest.mark.slow
def test_a_worker_ends_with_a_status_of_its_own_once_the_service_is_of_another_version(shared: Store) -> None:
    command = [*COMMAND, "worker", "--database", shared.settings.database]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "Jobs at a time: 1; Ctrl-C ends it.\n"
        set_version(shared, "9.9 with tables 0099")
        _, err = process.communicate(timeout=60)
    assert process.returncode == 4 and "and the service is 9.9 with tables 0099; install the same version here." in err


@pytest.fixture
def kept(tmp_path: Path) -> Store:
    """A store that knows the kinds of these tests."""
    return Store(ServiceSettings(data=tmp_path / "data", workers=1, job_functions=KINDS, lease_s=1.0))


def done_here(store: Store, kind: str, **request: object) -> str:
    """Do one job in this process; its ID."""
    job = store.add_job(kind, "here", {"number": 7, **request}, {"field/x": store.blobs.put_bytes(b"X")})
    run_next_job(store)
    return job.id


def test_a_job_finds_its_files_and_leaves_its_results(kept: Store) -> None:
    before = Path.cwd()
    done = kept.get_job(done_here(kept, "tiny", files=["field/x"]))
    assert (done.status, done.words, Path.cwd()) == ("done", "At work", before)
    assert kept.blobs.read_bytes(done.results[0].sha256) == made(7, b"X")["result.json"]
    assert list((kept.settings.data / "work").iterdir()) == []


def test_a_job_that_fails_says_why_in_one_sentence(kept: Store) -> None:
    refused, broken = kept.get_job(done_here(kept, "refused")), kept.get_job(done_here(kept, "broken"))
    assert (refused.status, refused.error) == ("failed", "width is 7; use another.")
    assert (broken.status, broken.error) == (
        "failed", "This is a fault of Headland (RuntimeError: something else); please report it."
    )  # fmt: skip


def list_pids(supervisor: WorkerSupervisor) -> list[int | None]:
    """The processes of the workers."""
    return [slot.process.pid for slot in supervisor._slots if slot.process is not None]


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
        first = list_pids(supervisor)
        store.cancel_job(long.id)
        last = store.add_job("tiny", "last", {"number": 2})
        wait_until(lambda: store.get_job(last.id).status == "done" and store.get_job(deadly.id).status == "failed")
        assert list_pids(supervisor) != first and store.get_job(long.id).status == "cancelled"
        assert "ended 2 times" in str(store.get_job(deadly.id).error)
        left = store.add_job("tiny", "left", {"number": 3, "step_s": 30})
        wait_until(lambda: store.get_job(left.id).status == "running")
        pids = list_pids(supervisor)
    finally:
        supervisor.stop()
    assert (store.get_job(left.id).status, store.get_job(left.id).tries) == ("queued", 0)
    assert pids and list_pids(supervisor) == []
    store.close()


@pytest.mark.slow
def test_workers_that_end_while_their_supervisor_stops_leave_no_job(kept: Store) -> None:
    """A service manager ends the workers at the same time as the supervisor."""
    supervisor = WorkerSupervisor(replace(kept.settings, workers=2), kept)
    supervisor.start()
    jobs = [kept.add_job("tiny", name, {"number": 1, "step_s": 30}) for name in ("one", "other")]
    wait_until(lambda: all(kept.get_job(job.id).words == "At work" for job in jobs))
    first, last = supervisor._slots
    process, stop_first = last.process, first.stop

    def end_last_and_stop() -> None:
        assert process is not None
        process.kill()
        time.sleep(3.0 * LOOK_PERIOD_S)
        stop_first()

    with patch.object(first, "stop", end_last_and_stop):
        supervisor.stop()
    assert [(kept.get_job(job.id).status, kept.get_job(job.id).tries) for job in jobs] == [("queued", 0)] * 2
    assert last.starts == 1


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes are found in /proc")
@pytest.mark.parametrize("kind", [pytest.param("sqlite", marks=pytest.mark.matrix), "postgresql"])
def test_jobs_are_done_once_though_server_and_workers_are_killed(kind: str, tmp_path: Path) -> None:
    with database(kind) as url:
        settings = ServiceSettings(data=tmp_path / "data", database=url, workers=1, lease_s=2.0)
        found = campaign(settings, jobs=12, kills=3, seed=3, whole=False, patience_s=120.0)
    assert (found.done, found.wrong, found.left_over) == (12, [], [])
    assert found.servers_killed >= 1 and found.servers_killed + found.workers_killed == 3


def test_a_worker_without_a_job_loads_what_the_first_one_needs(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    heard = list[str]()
    jobs = iter([None, None, "a job"])

    def claim(*_: Any) -> Any:
        heard.append("claim")
        return next(jobs)

    monkeypatch.setattr("signal.signal", lambda *_: None)  # a worker ignores Ctrl-C, this process does not
    monkeypatch.setattr(workers, "_claim_next_job", claim)
    monkeypatch.setattr(workers, "end_with_service", lambda: None)
    monkeypatch.setattr(workers, "run_and_store_job", lambda *_: heard.append("run"))
    monkeypatch.setattr(job_runs, "load_job_libraries", lambda: heard.append("load"))
    with pytest.raises(StopIteration):
        workers.run_worker(ServiceSettings(data=tmp_path), "w")
    assert heard == ["claim", "load", "claim", "claim", "run", "claim"]
