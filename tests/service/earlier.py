"""Databases as earlier versions made them, written in plain SQL: what they held, and what it means today."""

import hashlib
import json
import zlib
from typing import Any

import sqlalchemy as sa

from planner.service.store.database import WRITES_OPTION, Database, stamp_version, upgrade_tables
from tests.service.first_tables import FIRST_TABLES

SHA = {name: hashlib.sha256(name.encode()).hexdigest() for name in "abcdef"}
BEGAN = "2026-05-01T06:10:00.123Z"
ROWS = [[0, 0.0, 1.5], [1, 0.1, None]]
PROGRESS = {"centre": {"state": "paused", "legs": [3, 0]}, "mended": {"1": "mended one"}}
FLEET = {"times": 2.0, "way": "predict", "deadline_s": None, "begin_s": 1.5, "files": {"field": [".json", SHA["d"]]}}
TOKENS = {"reader": "read", "office": "control", "chief": "admin"}
MEANS = {"reader": "read", "office": "operator planner", "chief": "admin"}
"""What scopes of before the third version are since."""

OLD_REQUEST = {
    "swap": True,
    "before": "17:00",
    "draws": 100,
    "prefer": "surest",
    "along": "A-B",
    "tracks_only": True,
    "width": 3.5,
}
NEW_REQUEST = {
    "swap_axes": True, "deadline": "17:00", "samples": 100, "objective": "surest", "guidance_line": "A-B",
    "no_headland": True, "width": 3.5,
}  # fmt: skip
"""Options of a plan as they were called before the fourth version, and as they are since."""

Tables = dict[str, list[dict[str, Any]]]


def first() -> Tables:
    """What a database of the first version may hold: of every column a usual value and an odd one."""
    return {
        "tokens": [
            {"id": number, "name": name, "scope": scope, "sha256": SHA["abc"[number - 1]], "created": BEGAN}
            for number, (name, scope) in enumerate(TOKENS.items(), 1)
        ],
        "files": [
            {"id": 3, "kind": "field", "name": "Große Breite (1)", "suffix": ".geojson", "sha256": SHA["a"], "size": 3,
             "media": "application/geo+json", "created": BEGAN},
            {"id": 4, "kind": "log", "name": "log", "suffix": ".csv", "sha256": SHA["b"], "size": 2**31 - 1,
             "media": "text/csv; charset=utf-8", "created": BEGAN},
        ],
        "jobs": [
            job(7, "done", request={"field": "north", "width": 3.5, "name": "漢"}, inputs={"field/x.json": SHA["c"]},
                done=4, all=4, words="At work", finished=BEGAN, tries=1),
            job(8, "failed", error="width is 7; use another.", finished=BEGAN, tries=3),
            job(9, "running", worker="host:1:abc", lease=1777616400.5, tries=1),
            job(12, "queued", request={"field": "x"} | OLD_REQUEST, work={"field": "field/x.json"} | OLD_REQUEST),
        ],
        "results": [
            {"id": 5, "job": 7, "name": "result.json", "sha256": SHA["e"], "size": 4, "media": "application/json"},
        ],
        "fleets": [
            {"id": "0123456789abcdef", "name": "north fleet", "plan": '{"plan": "Ä"}', "settings": json.dumps(FLEET),
             "progress": json.dumps(PROGRESS), "created": BEGAN},
        ],
        "recordings": [
            {"id": 6, "fleet": "0123456789abcdef", "tractor": 1, "rows": zlib.compress(json.dumps(ROWS).encode())},
        ],
        "events": [
            {"id": 8, "time": BEGAN, "fleet": "0123456789abcdef", "who": "office", "what": "stop_all", "data": "{}"},
            {"id": 9, "time": BEGAN, "fleet": None, "who": "office", "what": "plan asked for",
             "data": json.dumps({"name": "x" * 500})},
        ],
    }  # fmt: skip


def second() -> Tables:
    """Since the second version files say how they are read."""
    tables = first()
    tables["files"][0]["options"] = json.dumps({"crs": "EPSG:25832", "swap": True})
    tables["files"][1]["options"] = "{}"
    return tables


def third() -> Tables:
    """Since the third version tokens have scopes per role, may be a robot's, and may end."""
    tables = second()
    for row in tables["tokens"]:
        del row["scope"]
        row |= {"scopes": MEANS[row["name"]], "fleet": None, "tractor": None, "expires": None}
    tables["tokens"].append(
        {"id": 9, "name": "robot", "scopes": "robot", "sha256": SHA["d"], "created": BEGAN,
         "fleet": "0123456789abcdef", "tractor": 2, "expires": "2036-05-01T06:10:00.123Z"}
    )  # fmt: skip
    return tables


def fourth() -> Tables:
    """Since the fourth version options have the names of today."""
    tables = third()
    for row in (*tables["files"], *tables["jobs"]):
        row |= {key: json.dumps(rename(json.loads(row[key]))) for key in ("options", "request", "work") if key in row}
    return tables


def fifth() -> Tables:
    """Since the fifth version files and jobs have owners, and files the time of their last change."""
    tables = fourth()
    tables["files"][0] |= {"owner": "office", "changed": BEGAN}
    tables["jobs"][0]["owner"] = "office"
    for row in (*tables["files"][1:], *tables["jobs"][1:]):
        row["owner"] = None
    tables["files"][1]["changed"] = None
    return tables


def sixth() -> Tables:
    """Since the sixth version tokens have identities, by which files and jobs name their owners."""
    tables = fifth()
    for row in tables["tokens"]:
        row["identity"] = f"{row['id']:032x}"
    for name in ("files", "jobs"):
        for row in tables[name]:
            row["owner_identity"] = None
    tables["files"][0]["owner_identity"] = f"{2:032x}"
    return tables


def seventh() -> Tables:
    """Since the seventh version there are bytes under way and turns, neither of which a backup holds."""
    return sixth()


def eighth() -> Tables:
    """Since the eighth version what is under way may be in a store."""
    return seventh()


def rename(values: dict[str, Any]) -> dict[str, Any]:
    """Options with the names of today."""
    names = dict(zip(OLD_REQUEST, NEW_REQUEST, strict=True))
    return {names.get(key, key): value for key, value in values.items()}


EARLIER = {
    f"{number:04d}": tables
    for number, tables in enumerate((first, second, third, fourth, fifth, sixth, seventh, eighth), start=1)
}
"""By revision: each is to stay as it is, for a database that was made so stays as it is, too."""


def job(number: int, status: str, **other: Any) -> dict[str, Any]:
    """A row of the table of jobs."""
    row = {
        "number": number, "id": f"{number:012x}", "kind": "plan", "name": "first", "status": status, "request": {},
        "work": {"field": "field/x.json"}, "inputs": {}, "done": 0, "all": 0, "words": "", "error": None,
        "created": BEGAN, "finished": None, "worker": None, "lease": None, "tries": 0,
    } | other  # fmt: skip
    return {key: json.dumps(value) if isinstance(value, dict) else value for key, value in row.items()}


def make(url: str, revision: str) -> Tables:
    """A database as the version of a revision left it behind; what it holds."""
    tables = EARLIER[revision]()
    database = Database(url)
    with database.engine.connect().execution_options(**{WRITES_OPTION: True}) as connection:
        FIRST_TABLES.create_all(connection)
        stamp_version(connection, "0001")
        upgrade_tables(connection, revision)
        connection.commit()
    with database.open_write_session() as session:
        for name, rows in tables.items():
            for row in rows:
                columns = ", ".join(f'"{each}"' for each in row)
                values = ", ".join(f":{each}" for each in row)
                session.execute(sa.text(f'INSERT INTO "{name}" ({columns}) VALUES ({values})'), row)
    database.close()
    return tables
