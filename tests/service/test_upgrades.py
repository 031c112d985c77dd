"""A database of every earlier version, on SQLite and PostgreSQL, means the same after it was brought up to date."""

import json
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory

from planner.service.access.permissions import build_caller
from planner.service.errors import ScopeError
from planner.service.settings import ServiceSettings
from planner.service.store.backup import _advance_sequence, back_up, restore_backup
from planner.service.store.database import MIGRATIONS_FOLDER, Database, get_current_version, list_versions
from planner.service.store.service_store import Store
from planner.service.store.tables import COPIED_TABLES, TableBase
from tests.service.databases import KINDS
from tests.service.earlier import BEGAN, EARLIER, FLEET, MEANS, NEW_REQUEST, PROGRESS, ROWS, SHA, Tables, make, rename

JSON = ("request", "work", "inputs", "settings", "progress", "data", "options")
DEFAULTS: dict[str, dict[str, Any]] = {
    "files": {"options": {}, "owner": None, "changed": None, "owner_identity": None},
    "jobs": {"owner": None, "owner_identity": None},
    "tokens": {"fleet": None, "tractor": None, "expires": None},
}
"""What later columns say of rows that are older than they are."""
EACH = [
    pytest.param(kind, revision, marks=() if (place + turn) % 2 == 0 else pytest.mark.matrix)
    for place, revision in enumerate(EARLIER)
    for turn, kind in enumerate(KINDS)
]
"""Every version on one database, in the matrix on the other too."""


def expected(store: Store, name: str, row: dict[str, Any]) -> dict[str, Any]:
    """A row as it is to be today; identities of before there were any are those that the store has given."""
    given = {each["name"]: each["identity"] for each in rows_of(store, "tokens")}
    if name == "tokens":
        row = {"identity": given[row["name"]]} | row
    if row.get("owner") and "owner_identity" not in row:
        row = row | {"owner_identity": given[row["owner"]]}
    today = DEFAULTS.get(name, {}) | {key: json.loads(value) if key in JSON else value for key, value in row.items()}
    if name in ("files", "jobs"):
        today |= {key: rename(today[key]) for key in ("options", "request", "work") if key in today}
    if name == "tokens" and "scope" in today:
        today["scopes"] = MEANS[today["name"]]
        del today["scope"]
    return today


def rows_of(store: Store, name: str) -> list[dict[str, Any]]:
    """All rows of a table, in the order of their keys."""
    table = TableBase.metadata.tables[name]
    with store.database.open_read_session() as session:
        found = session.execute(sa.select(table).order_by(*table.primary_key.columns)).mappings()
        return [dict(row) for row in found]


def check_meaning(store: Store, tables: Tables) -> None:
    """What the store makes of the rows, as the service asks for it."""
    done = store.get_job(f"{7:012x}", "plan")
    assert (done.status, done.request["name"], done.inputs) == ("done", "漢", {"field/x.json": SHA["c"]})
    assert [each.sha256 for each in done.results] == [SHA["e"]]
    waiting = store.get_job(f"{12:012x}", "plan")
    assert waiting.request == {"field": "x"} | NEW_REQUEST and waiting.work == {"field": "field/x.json"} | NEW_REQUEST
    assert [row.status for row in store.list_jobs()] == ["queued", "running", "failed", "done"]
    fleet = store.get_fleet("0123456789abcdef")
    assert (fleet.plan, fleet.settings, fleet.progress) == ('{"plan": "Ä"}', FLEET, PROGRESS)
    assert store.read_recording(fleet.id, 1) == ROWS and [each.id for each in store.list_events(8)] == [9]
    may = {
        row.name: {
            right for right in ("read", "plan", "operate", "drive", "administer") if build_caller(row).has_right(right)
        }
        for row in store.list_tokens()
        if row.name != "robot"
    }
    assert may == {
        "reader": {"read"}, "office": {"read", "plan", "operate"},
        "chief": {"read", "plan", "operate", "drive", "administer"},
    }  # fmt: skip
    robots = [build_caller(row) for row in store.list_tokens() if row.name == "robot"]
    assert all(each.has_right("drive", fleet.id, 2) and not each.has_right("drive", fleet.id, 1) for each in robots)
    assert len(store.list_tokens()) == len(tables["tokens"])


def check_goes_on(store: Store) -> None:
    """New rows are numbered after those that were there, and the queue is worked on."""
    claimed = store.claim_job("w")
    assert claimed is not None and claimed.number == 12
    assert store.add_job("plan", "next", {}).number > 12
    assert store.add_event(None, "office", "next") > 9 and store.create_token_text("next", "read").startswith("hl_")


def test_there_is_an_example_of_every_version() -> None:
    scripts = ScriptDirectory(str(MIGRATIONS_FOLDER))
    versions = {each.revision for each in scripts.walk_revisions()}
    assert set(EARLIER) == versions == set(list_versions()) and scripts.get_current_head() == get_current_version()


@pytest.mark.slow
@pytest.mark.parametrize(("both", "revision"), EACH, indirect=["both"])
def test_every_row_means_the_same_after_an_upgrade(both: ServiceSettings, revision: str) -> None:
    both.data.mkdir()
    tables = make(both.url, revision)
    database = Database(both.url)
    with database.open_write_session() as session:  # numbers were written by hand: PostgreSQL counts on from them
        for table in COPIED_TABLES:
            _advance_sequence(session.connection(), table)
    database.close()
    for _ in range(2):  # the second time nothing is to do
        store = Store(both)
        for name, rows in tables.items():
            assert rows_of(store, name) == [expected(store, name, row) for row in rows], name
        identities = [row["identity"] for row in rows_of(store, "tokens")]
        assert len(set(identities)) == len(tables["tokens"]) and all(len(each) == 32 for each in identities)
        check_meaning(store, tables)
        with store.database.engine.connect() as connection:
            assert compare_metadata(MigrationContext.configure(connection), TableBase.metadata) == []
        store.close()
    store = Store(both)
    check_goes_on(store)
    store.close()


@pytest.mark.parametrize(("both", "revision"), EACH, indirect=["both"])
def test_a_folder_of_an_earlier_version_is_backed_up_and_brought_back(
    both: ServiceSettings, tmp_path: Path, revision: str
) -> None:
    old = ServiceSettings(data=tmp_path / "old")
    old.data.mkdir()
    tables = make(old.url, revision)
    plain = Store(old)
    assert {plain.blobs.put_bytes(name.encode()) for name in SHA} == set(SHA.values())
    back_up(plain, tmp_path / "copy.zip")
    plain.close()
    store = Store(both)
    restore_backup(store, tmp_path / "copy.zip")
    for name in tables:
        assert rows_of(store, name) == [expected(store, name, row) for row in tables[name]], name
    check_goes_on(store)
    store.close()


def test_an_upgrade_that_fails_half_way_changes_nothing(both: ServiceSettings, monkeypatch: pytest.MonkeyPatch) -> None:
    both.data.mkdir()
    tables = make(both.url, "0001")
    real = sa.Connection.execute

    def failing(self: sa.Connection, statement: Any, *more: Any, **named: Any) -> Any:
        if isinstance(statement, sa.TextClause) and "operator planner" in statement.text:
            raise KeyboardInterrupt
        return real(self, statement, *more, **named)

    monkeypatch.setattr(sa.Connection, "execute", failing)
    with pytest.raises(KeyboardInterrupt):
        Store(both)
    monkeypatch.undo()
    store = Store(both)
    assert rows_of(store, "tokens") == [expected(store, "tokens", row) for row in tables["tokens"]]
    assert rows_of(store, "files")[0]["created"] == BEGAN
    store.close()


def test_what_an_earlier_token_of_a_name_made_is_not_that_of_the_token_of_today(both: ServiceSettings) -> None:
    both.data.mkdir()
    make(both.url, "0005")
    older, newer = "2026-04-30T06:10:00.000Z", "2026-05-02T06:10:00.000Z"
    database = Database(both.url)
    with database.open_write_session() as session:
        for number, created in ((8, older), (9, newer)):
            session.execute(sa.text(f"UPDATE jobs SET owner = 'office', created = '{created}' WHERE number = {number}"))
        session.execute(sa.text("UPDATE jobs SET owner = 'long gone' WHERE number = 12"))
    database.close()
    store = Store(both)
    office = build_caller(next(row for row in store.list_tokens() if row.name == "office"))
    may = {}
    for number in (7, 8, 9, 12):
        try:
            office.check_may_change(store.get_job(f"{number:012x}"), "The job")
            may[number] = True
        except ScopeError as refusal:
            may[number] = False
            assert ("an earlier token 'office'" in str(refusal)) == (number == 8)
    assert may == {7: True, 8: False, 9: True, 12: False}
    store.close()
