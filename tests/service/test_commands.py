"""The commands of the service: tokens, backups, and the service itself from outside."""

import asyncio
import os
import signal
import subprocess
import sys
import urllib.request
import zipfile
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import shapely
import sqlalchemy as sa

from planner.service.errors import ConflictError, ServiceError
from planner.service.gateway.back_office import BackOffice
from planner.service.settings import ServiceSettings
from planner.service.store.database import hold_service_lock
from planner.service.store.service_store import Store
from planner.service.store.tables import TokenRow
from planner.service.store.token_table import parse_expiry
from tests.examples import seldom
from tests.service.conftest import find_token
from tests.service.databases import KINDS, database

WORKER = ["worker", "--database", "postgresql://127.0.0.1:1/x"]
COMMAND = [sys.executable, "-W", "error", "-c", "from planner.cli.main import main; main()"]
SMALL_DEMONSTRATION = """
import sys
from planner.cli import robots
from planner.cli.main import main
robots.DEMO_FIELD, robots.DEMO_WIDTH_M = "small.geojson", 6.0
sys.argv = ["headland", "demo", "fleet", "--no-browser"]
main()
"""
TWO = """
import sys, time
from planner.cli import robots
from planner.cli.main import main
robots.HEADLAND_COMMAND = (sys.executable, "-c", "import time; time.sleep(120)")
def shown(folder, stack, *_):
    print(folder, *(stack.enter_context(robots._run_headland_command(())).pid for _ in range(2)), flush=True)
    time.sleep(120)
robots._run_demo = shown
sys.argv = ["headland", "demo", "fleet"]
main()
"""


def test_a_token_is_shown_once(run: Callable[..., tuple[int, str, str]], plain: Store, tmp_path: Path) -> None:
    status, out, _ = run("token", "new", "--scope", "operator", "--scope", "planner", "--data", tmp_path)
    token = out.strip()
    assert status == 0 and token.startswith("hl_")
    _, listed, _ = run("token", "list", "--data", tmp_path)
    assert listed.startswith("operator-planner-1  operator planner  ") and token not in listed
    assert listed.endswith("  never expires\n")
    assert all(token.encode() not in path.read_bytes() for path in tmp_path.rglob("*") if path.is_file())
    assert find_token(plain, token) is not None
    assert run("token", "revoke", "operator-planner-1", "--data", tmp_path)[0] == 0
    assert find_token(plain, token) is None


def test_a_token_for_a_robot_is_for_one_tractor_and_ends(
    run: Callable[..., tuple[int, str, str]], plain: Store, tmp_path: Path
) -> None:
    plain.save_fleet("f1", "north", "{}", {})
    words = ("token", "new", "--scope", "robot", "--fleet", "f1", "--tractor", "2", "--data", tmp_path)
    assert run(*words)[0] == 0
    status, out, err = run(*words, "--name", "short", "--expires", "90m")
    row = find_token(plain, out.strip())
    assert status == 0 and row is not None and (row.fleet, row.tractor, row.scopes) == ("f1", 2, "robot")
    assert f"expires {row.expires}" in err
    lines = run("token", "list", "--data", tmp_path)[1].splitlines()
    assert lines[0].startswith("robot-1  robot of tractor 2 of fleet f1  ") and lines[1].endswith(str(row.expires))
    ends = [
        datetime.fromisoformat(str(each.expires)) - datetime.fromisoformat(each.created) for each in plain.list_tokens()
    ]
    assert [round(each / timedelta(minutes=1)) for each in ends] == [30 * 24 * 60, 90]
    with plain.database.open_write_session() as session:
        session.execute(sa.update(TokenRow).values(expires="2026-01-01T00:00:00.000Z"))
    assert (
        "  expired 2026-01-01" in run("token", "list", "--data", tmp_path)[1] and find_token(plain, out.strip()) is None
    )


@pytest.mark.parametrize(("text", "minutes"), [("90m", 90), ("12h", 720), ("30d", 43_200)])
def test_an_end_is_so_much_later_or_after_a_day_or_at_a_time_of_a_zone(text: str, minutes: int) -> None:
    end = parse_expiry(text)
    assert end is not None and parse_expiry("never") is None
    assert (datetime.fromisoformat(end) - datetime.now(UTC)) / timedelta(minutes=1) == pytest.approx(minutes, abs=1.0)
    day = (datetime.now(UTC) + timedelta(days=10)).date()
    assert parse_expiry(day.isoformat()) == f"{day + timedelta(days=1)}T00:00:00.000Z"
    assert parse_expiry(f"{day}T18:00:00+02:00") == parse_expiry(f"{day}T16:00:00") == f"{day}T16:00:00.000Z"


@pytest.mark.parametrize(
    "text", ["2100-01-01", "0d", "99999d", "", "soon", "30 d", "999999d", "2001-01-01T00:00:00Z", "2030-13-01"]
)
def test_what_is_no_end_is_refused(text: str) -> None:
    with pytest.raises(ServiceError) as refusal:
        parse_expiry(text)
    assert len(str(refusal.value).splitlines()) == 1 and refusal.value.parameter == "expires"


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["token", "new", "--scope", "all"], "use read, planner, operator, robot or admin"),
        (["token", "new", "--scope", "read", "--name", "../x"], "cannot be used"),
        (["token", "new", "--scope", "robot", "--tractor", "1"], "give its fleet too"),
        (["token", "new", "--scope", "robot", "--fleet", "f1", "--tractor", "1"], "There is no fleet 'f1'"),
        (["token", "new", "--scope", "read", "--fleet", "f1"], "is bound to no tractor"),
        (["token", "new", "--scope", "robot", "--scope", "admin"], "has no other scope"),
        (["token", "new", "--scope", "read", "--expires", "soon"], "write 30d, 12h"),
        (["token", "new", "--scope", "read", "--expires", "2001-01-01"], "one that is to come"),
        (["token", "revoke", "nobody"], "There is no token 'nobody'"),
        (["serve", "--port", "99999"], "use 1 to 65535"),
        (["serve", "--host", "no host"], "is not an address"),
        (["serve", "--host", "0.0.0.0", "--port", "0"], "which need a token, and there is none"),
        (["serve", "--database", "mysql://x", "--port", "0"], "use SQLite or PostgreSQL"),
        (["backup", "copy.tar"], "does not end in .zip"),
        (["restore", "nothing.zip"], "no file nothing.zip"),
        (["restore", __file__], "cannot be read as a backup"),
        (["worker"], "Missing option '--database'"),
        (["worker", "--database", "x"], "The database is not a URL; write one such as"),
        (["worker", "--database", "sqlite:///x.db"], "A worker takes jobs from PostgreSQL; give the --database of"),
        ([*WORKER, "--workers", "0"], "--workers is 0; use 1 to 64."),
        (WORKER, "cannot be used: connection"),
        (
            [*WORKER, "--results", "results"],
            "Results cannot go to 'results': ValueError: it is no URL with a folder",
        ),
        ([*WORKER, "--results", "x9://results/farm"], "Results cannot go to 'x9://results/farm': ValueError: Protocol"),
        (["serve", "--workers", "0"], "Without workers of its own the service needs PostgreSQL"),
        (["serve", "--workers", "-1"], "--workers is -1; use 0 to 64."),
        (
            ["serve", "--results", "s3://results/farm"],
            "Results go by a store from workers on other machines",
        ),
    ],
)
def test_refusals_are_one_sentence(
    run: Callable[..., tuple[int, str, str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HEADLAND_DATA", str(tmp_path / "data"))
    status, out, err = run(*arguments)
    assert (status, out) == (2, "") and words in err and len(err.splitlines()) == 1 and err.startswith("Error: ")


def test_a_backup_holds_the_database(run: Callable[..., tuple[int, str, str]], tmp_path: Path) -> None:
    file = tmp_path / "copy.zip"
    assert run("backup", file, "--data", tmp_path / "data")[0] == 0
    assert zipfile.ZipFile(file).namelist() == ["headland.db", "manifest.json"]
    assert run("backup", file, "--data", tmp_path / "data")[0] == 2
    assert run("backup", file, "--data", tmp_path / "data", "--force")[0] == 0


@pytest.mark.parametrize("kind", KINDS)
def test_a_second_service_on_one_folder_or_database_is_refused(
    run: Callable[..., tuple[int, str, str]], kind: str, tmp_path: Path
) -> None:
    with database(kind) as url:
        url = url or f"sqlite:///{tmp_path / 'shared.db'}"
        first, second = (ServiceSettings(data=tmp_path / name, database=url) for name in ("one", "two"))
        for each in (first, second):
            each.data.mkdir()
        with hold_service_lock(first):
            status, out, err = run("serve", "--port", "0", "--data", first.data)
            assert (status, out) == (2, "") and len(err.splitlines()) == 1
            assert "Another headland serve" in err and str(first.data) in err
            with pytest.raises(ConflictError, match="--database"), hold_service_lock(second):
                pass
        with hold_service_lock(second):
            pass


@pytest.mark.matrix
@pytest.mark.skipif(os.name != "posix", reason="ends the service by a signal")
def test_the_service_serves_until_it_is_ended(tmp_path: Path) -> None:
    words = [*COMMAND, "serve", "--port", "0", "--data", str(tmp_path)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None and process.stderr is not None
            said = process.stdout.readline()
            address = next(word for word in said.split() if word.startswith("http://127.0.0.1:"))
            with urllib.request.urlopen(f"{address}api/v1/health", timeout=30) as answer:
                assert answer.status == 200 and b'"ok"' in answer.read()
            assert answer.headers["server"] is None
        finally:
            process.send_signal(signal.SIGINT)
        assert ended(process) == 0
        assert [line for line in process.stderr.read().splitlines() if not line.startswith("Compiling")] == []


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="looks at processes as Linux shows them")
def test_the_demonstration_ends_with_all_its_processes_and_shows_its_token_to_nobody_else(tmp_path: Path) -> None:
    parcel = shapely.to_geojson(shapely.box(4.0, 52.0, 4.0009, 52.00045))  # 62 m by 50 m
    (tmp_path / "small.geojson").write_text(parcel, encoding="utf-8")
    words = [sys.executable, "-c", SMALL_DEMONSTRATION]
    environment = os.environ | {"TMPDIR": str(tmp_path)}  # by which its processes are known
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(words, env=environment, cwd=tmp_path, **pipes) as demo:
        assert demo.stdout is not None and demo.stderr is not None
        said = next(line for line in demo.stdout if "operator token" in line or demo.poll() is not None)
        token = next(word for word in said.split() if word.startswith("hl_")).rstrip(".")
        running = started_in(tmp_path)
        assert len([line for line in running.values() if " robot " in line]) == 3
        assert not any(token in line for line in running.values())
        demo.send_signal(signal.SIGINT)
        assert ended(demo) == 0
        assert demo.stdout.read() == "Service and robots have ended.\n"
        said = demo.stderr.read()
        assert [line for line in said.splitlines() if not line.startswith("Compiling")] == [], said
    assert started_in(tmp_path) == {}


@pytest.mark.skipif(os.name != "posix", reason="ends it by a signal")
@pytest.mark.parametrize("how", [signal.SIGTERM, *seldom(signal.SIGINT)])
def test_however_the_demonstration_is_ended_it_leaves_no_process_and_no_folder(how: int) -> None:
    with subprocess.Popen([sys.executable, "-c", TWO], stdout=subprocess.PIPE, text=True) as demo:
        assert demo.stdout is not None
        folder, *ids = demo.stdout.readline().split()
        assert len(ids) == 2 and Path(folder).is_dir()
        demo.send_signal(how)
        assert ended(demo) == 0
    assert not Path(folder).exists()
    for each in ids:
        with pytest.raises(ProcessLookupError):
            os.kill(int(each), 0)


def ended(process: subprocess.Popen[str]) -> int:
    """The status with which a process ends; one that does not in a minute is killed, as nobody else would end it."""
    try:
        return process.wait(60)
    except subprocess.TimeoutExpired:
        process.kill()
        raise


def started_in(folder: Path) -> dict[int, str]:
    """Command lines of all processes whose temporary files go to a folder, by their ids."""
    found = {}
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if f"TMPDIR={folder}".encode() in (process / "environ").read_bytes().split(b"\0"):
                found[int(process.name)] = (process / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        except OSError:
            continue  # ended meanwhile, or somebody else's
    return found


def test_the_login_address_waits_until_the_pages_can_be_shown(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    office, pauses = BackOffice(ServiceSettings(data=tmp_path), lambda *_: None), list[float]()

    async def pause(seconds: float) -> None:
        pauses.append(seconds)
        office.url = "http://127.0.0.1:1" if sum(pauses) > 600.0 else None

    monkeypatch.setattr("asyncio.sleep", pause)
    asyncio.run(office.wait_until_ready())
    assert sum(pauses) > 600.0, "ten minutes on a busy machine are no reason to give up"
