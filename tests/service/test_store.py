"""The store, on both databases: names, tokens, files, jobs, fleets, migrations, backups."""

import time
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import sqlalchemy as sa
from hypothesis import given
from hypothesis import strategies as st

from planner.service.errors import ConflictError, DatabaseError, NotFoundError, ServiceError
from planner.service.settings import ServiceSettings
from planner.service.store.backup import back_up, restore_backup, sweep_unnamed_bytes
from planner.service.store.service_store import Store
from planner.service.store.store_part import check_name
from planner.service.store.tables import JobRow, ResultRow
from tests.service.conftest import find_token, store_done_job


def test_a_newer_or_strange_database_is_refused(both: ServiceSettings, store: Store) -> None:
    with store.database.open_write_session() as session:
        session.execute(sa.text("UPDATE alembic_version SET version_num = '9999'"))
    with pytest.raises(DatabaseError, match=r"newer Headland \(its version is 9999"):
        Store(both)
    with store.database.open_write_session() as session:
        session.execute(sa.text("DROP TABLE alembic_version"))
    with pytest.raises(DatabaseError, match="tables of other software"):
        Store(both)


def test_tokens_are_kept_as_digests_alone(store: Store, both: ServiceSettings) -> None:
    text = store.create_token_text("office", "planner operator")
    row = find_token(store, text)
    assert row is not None and (row.name, row.scopes, row.expires) == ("office", "operator planner", None)
    assert text.startswith("hl_") and len(text) > 40 and text not in repr(vars(row))
    assert find_token(store, text[:-1]) is None
    with pytest.raises(ConflictError):
        store.create_token_text("office", "read")
    with pytest.raises(ServiceError, match="use read, planner, operator, robot or admin"):
        store.create_token_text("other", "all")
    store.revoke_token("office")
    assert find_token(store, text) is None
    with pytest.raises(NotFoundError):
        store.revoke_token("office")


def test_a_file_keeps_its_name_until_it_is_deleted(store: Store) -> None:
    first = store.add_file("field", "north", b"one")
    assert store.add_file("field", "north", b"one").id == first.id
    with pytest.raises(ConflictError):
        store.add_file("field", "north", b"two")
    store.add_file("log", "north", b"two")
    assert store.blobs.read_bytes(store.get_file("field", "north").sha256) == b"one"
    store.delete_file("field", "north")
    with pytest.raises(NotFoundError):
        store.get_file("field", "north")
    for odd in ("", "\0", "\ud800", "n" * 10_000):
        with pytest.raises(NotFoundError):
            store.get_file("field", odd)


@given(st.text(st.sampled_from('aZ9ä漢 ._()+-/\\:~\0\n"<>|?*'), max_size=12))
def test_names_are_never_paths(name: str) -> None:
    try:
        kept = check_name(name)
    except ServiceError:
        return
    assert len(Path(kept).parts) == 1 and not set(kept) & set('/\\:\0\n"<>|?*') and not kept.startswith(".")
    assert check_name(kept) == kept


@pytest.mark.parametrize(
    "name", ["../x", "..", ".hidden", "a/b", "a\\b", "C:", "/etc/passwd", "con", "NUL.x", " a", "a\n", "x" * 101]
)
def test_paths_are_no_names(name: str) -> None:
    with pytest.raises(ServiceError):
        check_name(name)


def test_a_job_goes_its_way(store: Store) -> None:
    job = store.add_job("plan", "first", {"width": 3.0})
    assert (job.status, store.claim_job("w1").id) == ("queued", job.id)  # type: ignore[union-attr]
    assert store.claim_job("w2") is None
    assert store.report_job(job.number, "w1", (1, 4, "At work")) and not store.report_job(job.number, "w2")
    store.keep_results(job.number, {"a": b"1", "b": b"2"})
    assert not store.finish_job(job.number, "w2", {"a": b"2"})
    assert store.finish_job(job.number, "w1", {"a": b"1", "b": b"2"})
    done = store.get_job(job.id, "plan")
    assert (done.status, done.done, done.all, [each.name for each in done.results]) == ("done", 1, 4, ["a", "b"])
    assert store.blobs.read_bytes(store.get_result(job.id, "b").sha256) == b"2"
    assert not store.finish_job(job.number, "w1", {})
    with pytest.raises(NotFoundError):
        store.get_job(job.id, "day")
    store.delete_job(job.id)
    with store.database.open_read_session() as session:
        assert session.scalar(sa.select(sa.func.count()).select_from(ResultRow)) == 0


@pytest.mark.parametrize("is_deleted", [True, False])
def test_a_running_job_that_is_deleted_or_cancelled_is_nobodys(store: Store, is_deleted: bool) -> None:
    job = store.add_job("plan", "first", {})
    store.claim_job("w1")
    if is_deleted:
        store.delete_job(job.id)
    else:
        assert store.cancel_job(job.id).status == "cancelled"
    assert not store.report_job(job.number, "w1") and not store.finish_job(job.number, "w1", {})
    assert not store.fail_job(job.number, "w1", "why")
    with pytest.raises(NotFoundError if is_deleted else ConflictError):
        store.cancel_job(job.id)


def test_what_a_lost_worker_had_is_done_by_another_and_given_up_at_last(store: Store) -> None:
    job, other = store.add_job("plan", "first", {}), store.add_job("plan", "second", {})
    for attempt in range(3):
        while (claimed := store.claim_job(f"w{attempt}")) is not None and claimed.id != job.id:
            assert attempt > 0  # what was begun before comes after what was not
            store.finish_job(claimed.number, f"w{attempt}", {})
        assert claimed is not None and claimed.tries == attempt + 1
        store.release_jobs(f"w{attempt}", counts_try=True)
    ended = store.get_job(job.id)
    assert ended.status == "failed" and ended.error is not None and "ended 3 times" in ended.error
    assert store.get_job(other.id).status == "done"


def test_a_try_that_nobody_is_to_blame_for_is_not_counted_and_who_does_not_report_loses_its_job(store: Store) -> None:
    job = store.add_job("plan", "first", {})
    for _ in range(5):
        assert store.claim_job("w") is not None
        store.release_jobs("w", counts_try=False)
    assert (store.get_job(job.id).status, store.get_job(job.id).tries) == ("queued", 0)
    store.claim_job("w1")
    store.release_expired()
    assert store.get_job(job.id).status == "running"
    with store.database.open_write_session() as session:
        session.execute(sa.update(JobRow).values(lease=time.time() - 0.001))
    store.release_expired()
    assert store.get_job(job.id).status == "queued" and not store.report_job(job.number, "w1")


def test_no_job_is_claimed_twice(store: Store) -> None:
    wanted = {store.add_job("plan", f"job {number}", {}).id for number in range(30)}
    claimed: list[str] = []

    def work(worker: str) -> None:
        while (job := store.claim_job(worker)) is not None:
            claimed.append(job.id)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(work, ("w0", "w1", "w2", "w3")))
    assert len(claimed) == 30 and set(claimed) == wanted


def test_fleets_recordings_and_events(store: Store) -> None:
    store.save_fleet("f1", "north", '{"legs": []}', {"times": 2})
    store.save_progress("f1", {"leg": 3})
    fleet = store.get_fleet("f1")
    assert (fleet.plan, fleet.settings, fleet.progress) == ('{"legs": []}', {"times": 2}, {"leg": 3})
    store.add_recording("f1", 1, [[0.0, 1.5], [0.1, None]])
    store.add_recording("f1", 2, [[0.0, 9.0]])
    store.add_recording("f1", 1, [[0.2, 2.5]])
    assert store.read_recording("f1", 1) == [[0.0, 1.5], [0.1, None], [0.2, 2.5]]
    first = store.add_event("f1", "office", "stop all")
    second = store.add_event("f2", "office", "resume", {"tractor": 2})
    assert [each.id for each in store.list_events()] == [first, second]
    assert [each.data for each in store.list_events(first)] == [{"tractor": 2}]
    assert [each.id for each in store.list_events(0, "f1")] == [first]
    store.delete_fleet("f1")
    assert store.list_fleets() == [] and store.read_recording("f1", 1) == [] and len(store.list_events()) == 2
    with pytest.raises(NotFoundError):
        store.save_progress("f1", {})


def test_a_backup_is_brought_back_into_either_database_and_is_a_folder_for_another_service(
    store: Store, tmp_path: Path
) -> None:
    made = Store(ServiceSettings(data=tmp_path / "made"))
    made.add_file("field", "north", b"bytes of the field", options={"crs": "EPSG:25832"})
    job = store_done_job(made, {"width": 3.0}, {"field/north.geojson": made.blobs.put_bytes(b"as it was")})
    made.save_fleet("f1", "north", "{}", {})
    made.add_recording("f1", 1, [[0.0, 1.5]])
    seen = made.add_event(None, "office", "plan asked for")
    token = made.create_token_text("office", "admin")
    assert back_up(made, tmp_path / "copy.zip") == 3 and not list(tmp_path.glob(".headland-*"))
    made.close()
    with zipfile.ZipFile(tmp_path / "copy.zip") as packed:
        packed.extractall(tmp_path / "copy")
    assert restore_backup(store, tmp_path / "copy.zip") == 3
    unpacked = Store(ServiceSettings(data=tmp_path / "copy"))
    for again in (unpacked, store):
        file, kept = again.get_file("field", "north"), again.get_job(job.id)
        assert again.blobs.read_bytes(file.sha256) == b"bytes of the field" and file.options == {"crs": "EPSG:25832"}
        assert kept.request == {"width": 3.0} and again.blobs.read_bytes(kept.results[0].sha256) == b"made"
        assert again.blobs.read_bytes(kept.inputs["field/north.geojson"]) == b"as it was"
        assert find_token(again, token) is not None and again.read_recording("f1", 1) == [[0.0, 1.5]]
    unpacked.close()
    assert store.add_job("plan", "second", {}).number > job.number, "numbers go on after those of the backup"
    assert store.add_event(None, "office", "more") > seen and store.add_file("field", "south", b"") is not None
    with pytest.raises(ConflictError, match="nothing is written over"):
        restore_backup(store, tmp_path / "copy.zip")


def test_bytes_that_nobody_names_are_swept(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    store.add_file("field", "north", b"kept")
    job = store.add_job("plan", "first", {}, {"field/x": store.blobs.put_bytes(b"input")})
    stray = store.blobs.put_bytes(b"stray")
    assert sweep_unnamed_bytes(store) == 0  # what is new may be about to be named
    monkeypatch.setattr("planner.service.store.backup.SWEEP_MIN_AGE_S", -1.0)
    assert sweep_unnamed_bytes(store) == 1 and not store.blobs.get_path(stray).exists()
    store.delete_job(job.id)
    assert (
        sweep_unnamed_bytes(store) == 1 and store.blobs.read_bytes(store.get_file("field", "north").sha256) == b"kept"
    )


@pytest.mark.parametrize("url", ["mysql://x", "nonsense", "postgresql+nodriver://x/y"])
def test_other_databases_are_refused_in_a_sentence(url: str, tmp_path: Path) -> None:
    with pytest.raises(ServiceError) as refusal:
        Store(ServiceSettings(data=tmp_path, database=url))
    assert str(refusal.value).endswith(".") and "\n" not in str(refusal.value)
