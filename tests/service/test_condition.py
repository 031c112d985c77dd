"""A service knows how it is: writes are tried, a file that was moved is missed, and revocations wait for nothing."""

import asyncio
import os
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from fastapi import FastAPI
from starlette.testclient import TestClient

from planner.service.api.administration import METRICS_MEDIA_TYPE
from planner.service.errors import DatabaseError, NotFoundError, StorageError, TokenError
from planner.service.settings import DATABASE_FILE, ServiceSettings
from planner.service.store import backup
from planner.service.store import database as databases
from planner.service.store.backup import back_up, restore_backup
from planner.service.store.database_watch import STALE_S, DatabaseWatch, TokenCache
from planner.service.store.service_store import Store
from planner.service.store.store_part import REVOCATIONS_FOLDER, Revocation
from tests.service.conftest import bearer


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Store]:
    """A store on SQLite that waits little for other writers."""
    monkeypatch.setattr(databases, "SQLITE_BUSY_TIMEOUT_MS", 100)
    store = Store(ServiceSettings(data=tmp_path / "small"))
    store.database.engine.dispose()  # connections of before wait longer
    yield store
    store.close()


def lock(store: Store) -> sqlite3.Connection:
    """Another program that writes to the file and does not end."""
    other = sqlite3.connect(store.settings.data / DATABASE_FILE, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    return other


def move(store: Store) -> Path:
    """The place to which the file was moved."""
    away = store.settings.data / "away.db"
    (store.settings.data / DATABASE_FILE).rename(away)
    return away


def test_a_write_is_what_counts_and_it_counts_for_five_seconds(store: Store) -> None:
    now = 100.0
    watch = DatabaseWatch(store, lambda: now)
    assert not watch.is_fresh
    for _ in range(2):  # the row is made, then changed
        assert watch.write_once() and watch.is_fresh and watch.last_error is None
    now += STALE_S
    assert watch.is_fresh
    now += 0.1
    assert not watch.is_fresh and watch.age_s == pytest.approx(STALE_S + 0.1)


@pytest.mark.skipif(os.name == "nt", reason="open files cannot be moved there")
def test_a_file_that_was_moved_is_missed_and_not_made_anew(small: Store) -> None:
    text = small.create_token_text("office", "read")
    cache, watch = TokenCache(small), DatabaseWatch(small)
    assert cache.refresh() and watch.write_once()
    away = move(small)
    assert not watch.write_once() and "is gone; bring it back" in str(watch.last_error)
    assert not cache.refresh() and cache.find_token(text) is not None, "who was known stays known"
    with pytest.raises(sa.exc.OperationalError):
        small.add_event(None, "office", "meanwhile")
    assert not (small.settings.data / DATABASE_FILE).exists()
    away.rename(small.settings.data / DATABASE_FILE)
    assert watch.write_once() and cache.refresh() and small.add_event(None, "office", "afterwards") == 1


@pytest.mark.skipif(os.name == "nt", reason="open files cannot be moved there")
def test_another_database_in_its_place_is_not_used_and_a_copy_is(small: Store, tmp_path: Path) -> None:
    small.create_token("office", "read")
    Store(ServiceSettings(data=tmp_path / "other")).close()
    away, place = move(small), small.settings.data / DATABASE_FILE
    with pytest.raises(DatabaseError, match=f"its log {DATABASE_FILE}-wal is there; bring"):
        Store(small.settings)
    assert not place.exists(), "no empty one is made beside the log of one that is gone"
    log = place.with_name(f"{DATABASE_FILE}-wal")
    kept = log.read_bytes()
    shutil.copy(tmp_path / "other" / DATABASE_FILE, place)
    with pytest.raises(sa.exc.OperationalError, match="replaced by another database"):
        small.list_tokens()
    assert kept and log.read_bytes() == kept, "the log is that of the first"
    place.unlink()
    shutil.copy(away, place)
    assert [row.name for row in small.list_tokens()] == ["office"]


def test_a_revocation_holds_at_once_and_after_a_restart_while_the_file_is_locked(small: Store) -> None:
    text, cache, watch = small.create_token_text("office", "operator"), TokenCache(small), DatabaseWatch(small)
    assert cache.refresh() and cache.find_token(text) is not None
    sha256, other = str(next(iter(small.list_tokens())).sha256), lock(small)
    assert not watch.write_once() and "locked" in str(watch.last_error), "it can be read all the same"
    asyncio.run(cache.revoke_token("office", "chief"))
    assert cache.find_token(text) is None and sha256 in cache.find_invalid_tokens([sha256])
    with pytest.raises(TokenError):
        asyncio.run(cache.identify_token(text))
    assert cache.refresh() and cache.find_token(text) is None, "the database still has it"
    assert other.execute("SELECT name FROM tokens").fetchall() == [("office",)]
    started_again = TokenCache(Store(small.settings))
    assert started_again.refresh() and started_again.find_token(text) is None
    with pytest.raises(NotFoundError, match="no token 'office'"):
        asyncio.run(cache.revoke_token("office", "chief"))
    other.execute("COMMIT")
    assert watch.write_once() and watch.is_fresh and small.revocations.list_waiting() == {}
    assert other.execute("SELECT name FROM tokens").fetchall() == []
    other.close()
    assert [(event.who, event.what, event.data) for event in small.list_events()] == [
        ("chief", "token revoked", {"name": "office"})
    ]


def test_the_command_revokes_while_the_file_is_locked_and_other_files_beside_revocations_are_ignored(
    small: Store,
) -> None:
    text, other = small.create_token_text("office", "read"), lock(small)
    small.revoke_token("office")
    other.close()
    cache = TokenCache(small)
    assert cache.refresh() and cache.find_token(text) is None and small.list_tokens() == []
    small.write_revocations()
    assert small.list_events() == [] and small.create_token_text("office", "read") != text
    revocation = Revocation("0" * 64, "office", None)
    small.revocations.add(revocation)
    for name in ("README", ".DS_Store", f"{revocation.sha256}~"):
        (small.settings.data / REVOCATIONS_FOLDER / name).write_text("no revocation", encoding="utf-8")
    assert small.revocations.list_waiting() == {revocation.sha256: revocation}


@pytest.mark.parametrize("reads", ["tokens", "backup"])
def test_a_revocation_that_is_written_while_tokens_are_read_holds(
    small: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reads: str
) -> None:
    text, other = small.create_token_text("office", "read"), lock(small)
    small.revoke_token("office")  # which waits in a file, and is written as soon as the rows are read
    other.close()
    place, name = (small.database, "list_rows") if reads == "tokens" else (backup, "copy_rows")
    read: Any = getattr(place, name)

    def read_and_write(*what: Any) -> Any:
        rows = read(*what)
        small.write_revocations()
        return rows

    monkeypatch.setattr(place, name, read_and_write)
    if reads == "tokens":
        cache = TokenCache(small)
        assert cache.refresh() and cache.find_token(text) is None
        return
    back_up(small, tmp_path / "copy.zip")
    again = Store(ServiceSettings(data=tmp_path / "again"))
    restore_backup(again, tmp_path / "copy.zip")
    assert again.list_tokens() == [] and small.revocations.list_waiting() == {}
    again.close()


def test_a_revocation_that_cannot_be_stored_anywhere_holds_and_says_until_when(
    small: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    text, cache = small.create_token_text("office", "read"), TokenCache(small)

    def refuse(*_: object) -> None:
        raise StorageError("No room.")

    monkeypatch.setattr(small.revocations, "add", refuse)
    assert cache.refresh()
    other = lock(small)
    with pytest.raises(DatabaseError, match="'office' is refused from now on, but only until a restart"):
        asyncio.run(cache.revoke_token("office", "chief"))
    assert cache.find_token(text) is None
    other.close()


def test_the_log_stays_while_a_service_runs_and_others_open_and_close_the_database(small: Store) -> None:
    """A process that closes any descriptor of the file gives up its locks; the next to close takes the log away."""
    engine, file = small.database.engine, small.settings.data / DATABASE_FILE
    small.add_event(None, "office", "before")
    log = file.with_name(f"{DATABASE_FILE}-wal")
    code = "import sqlite3, sys; c = sqlite3.connect(sys.argv[1]); c.execute('SELECT * FROM tokens'); c.close()"
    with engine.connect() as first, engine.connect() as second:  # each looks at the file that it opens
        assert first.scalar(sa.text("SELECT 1")) == second.scalar(sa.text("SELECT 1"))
        kept = log.read_bytes()
        subprocess.run([sys.executable, "-c", code, str(file)], check=True)
        assert kept and log.read_bytes() == kept


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only the superuser gives files away")
def test_a_revocation_by_root_is_the_services(small: Store) -> None:
    small.create_token("office", "read")
    os.chown(small.settings.data, 4321, 1234)
    other = lock(small)
    small.revoke_token("office")
    other.close()
    folder = small.settings.data / REVOCATIONS_FOLDER
    (waiting,) = folder.iterdir()
    assert [(one.stat().st_uid, one.stat().st_gid) for one in (folder, waiting)] == [(4321, 1234)] * 2


def test_a_backup_holds_no_token_whose_revocation_waits(small: Store, both: ServiceSettings, tmp_path: Path) -> None:
    small.create_token("leaver", "read")
    small.create_token("office", "read")
    small.check_write()
    other = lock(small)
    small.revoke_token("leaver")
    back_up(small, tmp_path / "copy.zip")
    other.close()
    restored = Store(both)
    restored.check_write()  # as a service does that ran on it once
    restore_backup(restored, tmp_path / "copy.zip")
    assert [row.name for row in restored.list_tokens()] == ["office"]
    restored.close()


def test_readiness_and_figures_follow_the_writes(app: FastAPI, client: TestClient) -> None:
    state: Any = app.state
    assert client.get("/api/v1/ready").json() == {"ready": True, "faults": []}
    figures = client.get("/metrics")
    assert figures.headers["content-type"] == METRICS_MEDIA_TYPE and "headland_ready 1.0" in figures.text
    for name in ("headland_database_write_age_seconds", "headland_database_write_seconds", "headland_bodies_bytes 0.0",
                 "headland_disk_free_bytes"):  # fmt: skip
        assert f"\n{name}" in figures.text, name
    state.watch.close()
    state.watch._succeeded_at -= STALE_S + 2.0
    answer = client.get("/api/v1/ready")
    assert answer.status_code == 503 and "has taken no writes for" in answer.json()["faults"][0]
    assert "headland_ready 0.0" in client.get("/metrics").text
    assert client.get("/api/v1/health").json()["status"] == "degraded"


def test_a_later_token_of_a_name_owns_nothing_of_the_earlier_one(app: FastAPI, client: TestClient) -> None:
    first, chief = bearer(app, "planner"), bearer(app, "admin")
    copied = client.post("/api/v1/fields/denmark/copy", json={"name": "legacy"}, headers=first)
    assert copied.status_code == 201 and len(copied.json()["owner_identity"]) == 32
    assert client.get("/api/v1/me", headers=first).json()["identity"] == copied.json()["owner_identity"]
    assert client.delete("/api/v1/tokens/a planner", headers=chief).status_code == 204
    assert client.get("/api/v1/fields", headers=first).status_code == 401
    second = bearer(app, "planner")
    refused = client.delete("/api/v1/fields/legacy", headers=second)
    assert refused.status_code == 403 and "an earlier token 'a planner'" in refused.json()["error"]
    assert client.delete("/api/v1/fields/legacy", headers=chief).status_code == 204
