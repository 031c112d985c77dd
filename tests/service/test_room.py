"""A disk that is full: refused in a sentence, nothing half written, and jobs wait until there is room."""

import errno
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

import pytest
import sqlalchemy as sa

from planner.service.errors import StorageError
from planner.service.jobs.workers import WorkerSupervisor, run_and_store_job
from planner.service.settings import MEGABYTE_BYTES, ServiceSettings
from planner.service.store.service_store import Store
from planner.service.store.tables import JobRow
from tests.service.conftest import BOTH, SMALL, bearer, client_of, wait_until
from tests.service.kinds import KINDS, made
from tests.service.one_process import create_app

SIZE_MB = 8
STAND_IN = "stand-in"


class Disk:
    """A small disk of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder, self._stand_in = folder, folder / STAND_IN

    def fill(self, leave: int = 0) -> None:
        """Leave so many bytes free."""
        free = os.statvfs(self.folder)
        with open(self._stand_in, "ab") as stream:
            os.posix_fallocate(stream.fileno(), stream.tell(), max(1, free.f_bavail * free.f_frsize - leave))

    def free(self) -> None:
        """Make room again."""
        self._stand_in.unlink(missing_ok=True)


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    """A disk of eight megabytes, where this user may mount one."""
    folder = tmp_path / "disk"
    folder.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", f"size={SIZE_MB}m", "tmpfs", str(folder)]
    if sys.platform != "linux" or os.geteuid() != 0 or subprocess.run(words, capture_output=True).returncode != 0:
        pytest.skip("only root mounts a disk")
    try:
        yield Disk(folder)
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def of(disk: Disk, reserve_mb: int = 0) -> ServiceSettings:
    """Settings of a service all of whose data is on the disk."""
    data = disk.folder / "data"
    return ServiceSettings(data=data, reserve_mb=reserve_mb, workers=0, upload_mb=4, job_functions=KINDS, lease_s=1.0)


def test_bytes_for_which_there_is_no_room_leave_nothing_behind_and_a_database_keeps_all_it_had(disk: Disk) -> None:
    store, kept = Store(of(disk)), list[int]()
    first = store.blobs.put_bytes(b"first")
    disk.fill(leave=100_000)
    with pytest.raises(StorageError, match=r"^No room is left .*\.$"):
        store.blobs.put_bytes(os.urandom(300_000))
    assert [path.name for path in store.blobs.list_paths()] == [first]
    disk.free()
    disk.fill(leave=MEGABYTE_BYTES)
    with pytest.raises(StorageError):
        for number in range(10_000):
            kept.append(store.add_event(None, "office", "event", {"text": "x" * 5_000, "number": number}))
    events = store.list_events()
    while more := store.list_events(events[-1].id):
        events += more
    assert [each.data["number"] for each in events] == list(range(len(kept)))
    with store.database.open_read_session() as session:
        assert session.scalar(sa.text("PRAGMA integrity_check")) == "ok"
    disk.free()
    assert store.add_event(None, "office", "again") > 0
    assert store.blobs.read_bytes(store.blobs.put_bytes(b"second" * 100_000)) == b"second" * 100_000
    store.close()


def test_what_a_write_says_of_a_full_disk_is_believed(plain: Store, monkeypatch: pytest.MonkeyPatch) -> None:

    def full(_number: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("planner.service.store.disk_storage.os.fsync", full)
    with pytest.raises(StorageError):
        plain.add_file("field", "north", SMALL)
    assert plain.list_files("field") == [] and plain.blobs.list_paths() == []


def test_a_reserve_stays_free_for_the_database(disk: Disk) -> None:
    store = Store(of(disk, reserve_mb=4))
    store.blobs.check_disk_space(2 * MEGABYTE_BYTES)
    with pytest.raises(StorageError):
        store.blobs.check_disk_space(5 * MEGABYTE_BYTES)
    disk.fill(leave=3 * MEGABYTE_BYTES)
    with pytest.raises(StorageError):
        store.blobs.put_bytes(b"small")
    assert store.add_event(None, "office", "stop all") == 1, "what was ordered is still written down"
    store.close()


def test_requests_are_refused_in_a_sentence_and_go_on_once_there_is_room(disk: Disk) -> None:
    app = create_app(of(disk, reserve_mb=1), reads_inline=True)
    with client_of(app) as client:
        token = bearer(app, BOTH)
        disk.fill(leave=500_000)
        answer = client.post("/api/v1/fields", files={"file": ("x.geojson", SMALL)}, headers=token)
        assert answer.status_code == 507 and answer.json()["error"].startswith("No room is left on the disk")
        assert len(answer.json()["error"].splitlines()) == 1
        assert "x" not in [each["name"] for each in client.get("/api/v1/fields", headers=token).json()["items"]]
        disk.free()
        assert client.post("/api/v1/fields", files={"file": ("x.geojson", SMALL)}, headers=token).status_code == 201


def test_a_body_that_finds_no_room_while_it_comes_is_refused(disk: Disk, monkeypatch: pytest.MonkeyPatch) -> None:
    app = create_app(ServiceSettings(data=disk.folder.parent / "data", workers=0, upload_mb=4), reads_inline=True)
    disk.fill()
    monkeypatch.setattr(tempfile, "tempdir", str(disk.folder))
    with client_of(app) as client:
        large = b" " * (3 * MEGABYTE_BYTES)
        answer = client.post("/api/v1/logs", files={"file": ("x.csv", large)}, headers=bearer(app, BOTH))
        assert answer.status_code == 507 and "No room is left" in answer.json()["error"]


def test_a_server_that_says_its_disk_is_full_is_believed(store: Store) -> None:
    if store.database.engine.dialect.name == "sqlite":
        with pytest.raises(StorageError), store.database.open_write_session() as session:
            session.execute(sa.text("PRAGMA max_page_count = 1"))
            session.execute(sa.text("CREATE TABLE large AS SELECT zeroblob(1000000) AS one"))
        return
    with pytest.raises(StorageError), store.database.open_write_session() as session:
        session.execute(sa.text("DO $$ BEGIN RAISE EXCEPTION 'could not extend file' USING ERRCODE = '53100'; END $$"))
    with pytest.raises(sa.exc.DBAPIError), store.database.open_write_session() as session:
        session.execute(sa.text("DO $$ BEGIN RAISE EXCEPTION 'another' USING ERRCODE = '53000'; END $$"))


@pytest.mark.slow
def test_a_job_waits_for_room_and_no_try_is_counted(disk: Disk) -> None:
    store = Store(of(disk, reserve_mb=2))
    job = store.add_job("tiny", "here", {"number": 7})
    claimed = store.claim_job("here")
    assert claimed is not None
    disk.fill(leave=MEGABYTE_BYTES)
    working = threading.Thread(target=run_and_store_job, args=(store, "here", claimed))
    working.start()
    wait_until(lambda: store.get_job(job.id).words == StorageError.waiting)
    time.sleep(2 * store.settings.lease_s)
    store.release_expired()
    waiting = store.get_job(job.id)
    assert (waiting.status, waiting.tries, waiting.error, waiting.results) == ("running", 1, None, [])
    disk.free()
    working.join(60)
    done = store.get_job(job.id)
    assert (done.status, done.words, done.tries) == ("done", "At work", 1)
    assert store.blobs.read_bytes(done.results[0].sha256) == made(7)["result.json"]
    store.close()


@pytest.mark.slow
def test_a_job_whose_own_files_find_no_room_is_done_again(disk: Disk, monkeypatch: pytest.MonkeyPatch) -> None:
    store = Store(of(disk))
    job = store.add_job("tiny", "here", {"number": 7}, {"field/x": store.blobs.put_bytes(b"X" * 200_000)})
    claimed = store.claim_job("here")
    assert claimed is not None
    disk.fill(leave=100_000)
    threading.Timer(1.5, disk.free).start()
    run_and_store_job(store, "here", claimed)
    assert store.get_job(job.id).status == "done" and list((store.settings.data / "work").iterdir()) == []
    store.close()


def test_after_a_time_without_room_who_is_alive_reports_before_anything_is_released(tmp_path: Path) -> None:
    store = Store(ServiceSettings(data=tmp_path, workers=0, lease_s=1.0))
    supervisor = WorkerSupervisor(store.settings, store)
    job = store.add_job("plan", "first", {})
    assert store.claim_job("w") is not None
    with store.database.open_write_session() as session:
        session.execute(sa.update(JobRow).values(lease=time.time() - 60.0))
    with patch.object(store, "release_expired", side_effect=StorageError("No room.")):
        supervisor._release_unreported()
    supervisor._release_unreported()
    assert store.get_job(job.id).status == "running" and store.report_job(job.number, "w")
    with store.database.open_write_session() as session:
        session.execute(sa.update(JobRow).values(lease=time.time() - 60.0))
    supervisor._release_unreported()
    assert store.get_job(job.id).status == "queued", "nobody has reported since"
    store.close()
