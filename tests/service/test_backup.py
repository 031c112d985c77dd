"""Backups that lack something or are damaged: refused in a sentence that names it, and nothing is changed."""

import json
import sqlite3
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa

from planner.service.errors import ServiceError, StorageError
from planner.service.settings import DATABASE_FILE, MEGABYTE_BYTES, ServiceSettings
from planner.service.store.backup import MANIFEST_FILE, back_up, parse_manifest, restore_backup
from planner.service.store.disk_storage import BlobStore
from planner.service.store.service_store import Store
from planner.service.store.tables import TableBase
from tests.service.conftest import store_done_job
from tests.service.databases import KINDS

Parts = dict[str, bytes]
Damage = Callable[[Parts, Path], Parts]

NEWER = "UPDATE alembic_version SET version_num = '9999'"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Parts:
    """The parts of a backup that has something of everything."""
    folder = tmp_path_factory.mktemp("whole")
    store = Store(ServiceSettings(data=folder / "data"))
    store.add_file("field", "north", b"bytes of the field")
    store_done_job(store, {"width": 3.0}, {"field/north.geojson": store.blobs.put_bytes(b"as it was")})
    store.save_fleet("f1", "north", "{}", {"files": {"field": [".json", store.blobs.put_bytes(b"of the fleet")]}})
    store.add_recording("f1", 1, [[number, 1.5] for number in range(2_000)])
    store.create_token_text("robot", "robot", fleet="f1", tractor=1)
    for number in range(300):
        store.add_event(None, "office", "event", {"number": number})
    back_up(store, folder / "copy.zip")
    store.close()
    with zipfile.ZipFile(folder / "copy.zip") as packed:
        return {name: packed.read(name) for name in packed.namelist()}


def written(path: Path, parts: Parts, how: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", how) as packed:
        for name, content in parts.items():
            packed.writestr(name, content)
    return path


def with_hashes(parts: Parts) -> Parts:
    """The same with a manifest that is right about the database, as whoever wants to be believed would make it."""
    import hashlib

    manifest = json.loads(parts[MANIFEST_FILE])
    entry = {"size": len(parts[DATABASE_FILE]), "sha256": hashlib.sha256(parts[DATABASE_FILE]).hexdigest()}
    manifest["files"][DATABASE_FILE] = entry
    return parts | {MANIFEST_FILE: json.dumps(manifest).encode()}


def blob(parts: Parts) -> str:
    """The name of a part that is no database."""
    return next(name for name in parts if name.startswith("bytes/"))


def rows(store: Store) -> int:
    """Rows of all tables."""
    with store.database.open_read_session() as session:
        return sum(session.scalar(sa.select(sa.func.count()).select_from(table)) or 0
                   for table in TableBase.metadata.sorted_tables)  # fmt: skip


def changed(parts: Parts, folder: Path, *statements: str) -> Parts:
    """The same with a database that was changed, and a manifest that is right about it."""
    copy = folder / "changed.db"
    copy.write_bytes(parts[DATABASE_FILE])
    connection = sqlite3.connect(copy, isolation_level=None)
    for each in statements:
        connection.execute(each)
    connection.close()
    return with_hashes(parts | {DATABASE_FILE: copy.read_bytes()})


def zeroed(parts: Parts) -> bytes:
    """The database with the third quarter of its pages zeroed."""
    size = len(parts[DATABASE_FILE])
    return parts[DATABASE_FILE][: size // 2] + bytes(size // 4) + parts[DATABASE_FILE][size // 2 + size // 4 :]


def files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def without(parts: Parts, name: str) -> Parts:
    return {each: content for each, content in parts.items() if each != name}


def manifest_of(parts: Parts, **other: Any) -> Parts:
    return parts | {MANIFEST_FILE: json.dumps(json.loads(parts[MANIFEST_FILE]) | other).encode()}


def naming(parts: Parts, name: str, size: int = 1) -> Parts:
    """The same with a manifest that names one part more."""
    files = json.loads(parts[MANIFEST_FILE])["files"] | {name: {"size": size, "sha256": "0" * 64}}
    return manifest_of(parts, files=files)


def by(*statements: str) -> Damage:
    """A damage that statements do to the database."""
    return lambda parts, folder: changed(parts, folder, *statements)


def adding(name: str) -> Damage:
    """A damage that puts in one part more, and names it."""
    return lambda parts, _: naming(parts | {name: b"x"}, name)


DAMAGES: dict[str, tuple[Damage, str]] = {
    "no manifest": (
        lambda parts, _: without(parts, MANIFEST_FILE),
        "has no manifest.json, .* unpack it into an empty folder",
    ),
    "nothing of ours": (lambda parts, _: {"letter.txt": b"dear"}, "it has no headland.db"),
    "bytes missing": (lambda parts, _: without(parts, blob(parts)), "its part bytes/.* is missing"),
    "database missing": (lambda parts, _: without(parts, DATABASE_FILE), "its part headland.db is missing"),
    "bytes changed": (lambda parts, _: parts | {blob(parts): b"other"}, "its part bytes/.* has other bytes"),
    "bytes longer": (
        lambda parts, _: parts | {blob(parts): parts[blob(parts)] + bytes(10**7)},
        "its part bytes/.* has other bytes",
    ),
    "page zeroed": (lambda parts, _: parts | {DATABASE_FILE: zeroed(parts)}, "its part headland.db has other bytes"),
    "page zeroed, with hashes": (
        lambda parts, _: with_hashes(parts | {DATABASE_FILE: zeroed(parts)}),
        "its headland.db (cannot be read|does not hold)",
    ),
    "cut off": (
        lambda parts, _: with_hashes(parts | {DATABASE_FILE: parts[DATABASE_FILE][:-4096]}),
        "its headland.db (cannot be read|does not)",
    ),
    "no database": (
        lambda parts, _: with_hashes(parts | {DATABASE_FILE: b"no database"}),
        "its headland.db is no database",
    ),
    "strange part": (lambda parts, _: parts | {"../evil": b""}, "does not name '../evil'"),
    "strange part that is named": (adding("../evil"), "names '../evil', which is no part"),
    "rooted part that is named": (adding("/etc/evil"), "names '/etc/evil', which is no part"),
    "another name for bytes": (adding("bytes/aa/" + "a" * 64), "gives no SHA-256"),
    "manifest cut off": (
        lambda parts, _: parts | {MANIFEST_FILE: parts[MANIFEST_FILE][:-20]},
        "its manifest.json cannot be used",
    ),
    "manifest nested": (lambda parts, _: parts | {MANIFEST_FILE: b"[" * 100_000}, "its manifest.json cannot be used"),
    "manifest of nothing": (lambda parts, _: parts | {MANIFEST_FILE: b"null"}, "its manifest.json cannot be used"),
    "sizes that are none": (
        lambda parts, _: manifest_of(parts, files={DATABASE_FILE: {"size": True}}),
        "cannot be used, files.*size",
    ),
    "another form": (lambda parts, _: manifest_of(parts, form=2), "cannot be used, form is 2; use 1"),
    "a newer version": (
        lambda parts, folder: manifest_of(changed(parts, folder, NEWER), migration="9999"),
        "of a newer Headland",
    ),
    "another version": (lambda parts, _: manifest_of(parts, migration="0001"), "is not of the version"),
    "row without its owner": (
        by("PRAGMA foreign_keys=OFF", "DELETE FROM fleets"),
        "rows of its table recordings belong to none of fleets",
    ),
    "a trigger": (by("CREATE TRIGGER evil AFTER INSERT ON events BEGIN DELETE FROM tokens; END"), "has a trigger evil"),
    "a file more named": (
        by(f"UPDATE files SET sha256 = '{'b' * 64}'"),
        "its database names bytes/bb/b*, which is missing",
    ),
    "a file less named": (by("DELETE FROM files"), "nothing in its database names bytes/"),
    "rows that cannot be read": (
        by("UPDATE events SET data = 'no JSON' WHERE id = 250"),
        "rows of its headland.db cannot be read",
    ),
}


EACH_DAMAGE = [
    pytest.param(kind, how, marks=() if (place + turn) % 2 == 0 else pytest.mark.matrix)
    for place, how in enumerate(DAMAGES)
    for turn, kind in enumerate(KINDS)
]
"""Every damage on one database, in the matrix on the other too."""


@pytest.mark.parametrize(("both", "how"), EACH_DAMAGE, indirect=["both"])
def test_a_damaged_backup_is_refused_and_nothing_is_changed(
    both: ServiceSettings, whole: Parts, tmp_path: Path, how: str
) -> None:
    damage, words = DAMAGES[how]
    store = Store(both)
    kept = store.blobs.put_bytes(b"as it was")  # which the backup has as well
    file = written(tmp_path / "copy.zip", damage(whole, tmp_path))
    before = files(both.data)
    with pytest.raises(ServiceError, match=words) as refusal:
        restore_backup(store, file)
    assert str(refusal.value).endswith(".") and len(str(refusal.value).splitlines()) == 1
    assert rows(store) == 0 and files(both.data) == before
    assert store.blobs.read_bytes(kept) == b"as it was" and not (tmp_path / "evil").exists()
    assert restore_backup(store, written(tmp_path / "whole.zip", whole)) == 4 and rows(store) == 306
    store.close()


def test_a_disk_that_is_full_on_the_way_leaves_nothing_behind(
    both: ServiceSettings, whole: Parts, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, put, puts = Store(both), BlobStore.put_bytes, 0

    def last(self: BlobStore, content: bytes) -> str:
        nonlocal puts
        puts += 1
        if puts == 3:
            raise StorageError("No room.")
        return put(self, content)

    monkeypatch.setattr(BlobStore, "put_bytes", last)
    with pytest.raises(StorageError):
        restore_backup(store, written(tmp_path / "copy.zip", whole))
    assert rows(store) == 0 and store.blobs.list_paths() == []
    store.close()


def test_a_part_that_is_there_twice_is_refused(plain: Store, whole: Parts, tmp_path: Path) -> None:
    manifest = parse_manifest(whole[MANIFEST_FILE])
    assert set(manifest.files) == set(whole) - {MANIFEST_FILE} and manifest.migration == "0008"
    assert all(manifest.files[name].size == len(whole[name]) for name in manifest.files)
    file = written(tmp_path / "copy.zip", whole)
    with warnings.catch_warnings(), zipfile.ZipFile(file, "a") as packed:
        warnings.simplefilter("ignore")
        packed.writestr(blob(whole), b"other")
    with pytest.raises(ServiceError, match=r"the part 'bytes/.*' twice"):
        restore_backup(plain, file)


def test_a_bomb_is_refused_before_it_is_unpacked(plain: Store, whole: Parts, tmp_path: Path) -> None:
    file = tmp_path / "bomb.zip"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed, packed.open(MANIFEST_FILE, "w") as stream:
        for _ in range(100):
            stream.write(bytes(MEGABYTE_BYTES))
    with pytest.raises(ServiceError, match=r"its manifest.json has \d+ bytes"):
        restore_backup(plain, file)
    with pytest.raises(StorageError, match="No room"):
        restore_backup(
            plain, written(file, naming(whole | {"bytes/00/" + "0" * 64: b""}, "bytes/00/" + "0" * 64, 10**18))
        )
    written(file, whole, zipfile.ZIP_LZMA)
    with pytest.raises(ServiceError, match="packed another way"):
        restore_backup(plain, file)
    assert rows(plain) == 0 and plain.blobs.list_paths() == []


@pytest.mark.slow
def test_whatever_byte_of_an_archive_is_flipped_all_comes_back_or_nothing(whole: Parts, tmp_path: Path) -> None:
    refused, content = 0, bytearray(written(tmp_path / "copy.zip", whole).read_bytes())
    for place in range(100, len(content) - 200, max(1, len(content) // 16)):
        content[place] ^= 0x55
        file = tmp_path / "flipped.zip"
        file.write_bytes(content)
        content[place] ^= 0x55
        store = Store(ServiceSettings(data=tmp_path / str(place)))
        try:
            restore_backup(store, file)
        except ServiceError:
            refused += 1
            assert rows(store) == 0 and store.blobs.list_paths() == [], place
        else:  # of the time that a part was packed, say
            assert rows(store) == 306 and len(store.blobs.list_paths()) == 4, place
        store.close()
    assert refused > 8


def test_no_backup_is_made_of_what_is_not_whole(both: ServiceSettings, store: Store, tmp_path: Path) -> None:
    file = store.add_file("field", "north", b"bytes of the field")
    place = store.blobs.get_path(file.sha256)
    place.write_bytes(b"other")
    with pytest.raises(ServiceError, match="of the field 'north' are damaged"):
        back_up(store, tmp_path / "copy.zip")
    place.unlink()
    with pytest.raises(ServiceError, match="of the field 'north' are gone"):
        back_up(store, tmp_path / "copy.zip")
    assert not (tmp_path / "copy.zip").exists() and not list(tmp_path.glob(".headland-*"))
