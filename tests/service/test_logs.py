"""Log lines: one each with time, level and request, the same only so often; and when a kept process begins anew."""

import asyncio
import io
import itertools
import logging
import re
from types import SimpleNamespace
from typing import Any

import pytest
from starlette.types import Message, Receive, Scope, Send

from planner.service import kept_process
from planner.service.gateway.request_logs import REQUEST_ID, LogfmtFormatter, RepeatFilter, RequestIdMiddleware
from planner.service.kept_process import KeptProcess
from tests.service.conftest import wait_until


def write(record: logging.LogRecord) -> str:
    return LogfmtFormatter().format(record)


def make_record(message: str, exc_info: Any = None) -> logging.LogRecord:
    return logging.LogRecord("headland", logging.WARNING, "", 0, message, None, exc_info)


def test_a_line_has_time_level_logger_request_and_message() -> None:
    before = REQUEST_ID.set("ab12")
    try:
        line = write(make_record('A name with "quotes"\nand a line break.'))
    finally:
        REQUEST_ID.reset(before)
    assert "\n" not in line
    assert re.fullmatch(
        r'time=\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z level=warning logger=headland request=ab12 '
        r'message="A name with \\"quotes\\"\\nand a line break."', line
    )  # fmt: skip
    assert " request=" not in write(make_record("Nobody asked."))


def test_a_traceback_stays_in_its_line_and_of_a_long_one_both_ends_are_kept() -> None:
    try:
        raise ValueError("x" * 5000 + " at last")
    except ValueError as error:
        line = write(make_record("It failed", exc_info=(type(error), error, error.__traceback__)))
    assert "\n" not in line and "Traceback" in line and "at last" in line and len(line) < 2600


def test_the_same_message_passes_a_few_times_a_minute() -> None:
    now = [0.0]
    repeats, stream = RepeatFilter(lambda: now[0]), io.StringIO()
    handler = logging.StreamHandler(stream)
    handler.addFilter(repeats)
    for _ in range(100):
        handler.handle(make_record("again"))
    handler.handle(make_record("another"))
    assert stream.getvalue().count("again\n") == 4 and stream.getvalue().count("not logged again within 60 s") == 1
    assert "another" in stream.getvalue()
    now[0] = 61.0
    handler.handle(make_record("again"))
    assert stream.getvalue().endswith("again\n")


def test_every_answer_has_the_id_of_its_request_and_a_caller_cannot_choose_it() -> None:
    seen: list[tuple[str, int]] = []
    inside: list[str | None] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        inside.append(REQUEST_ID.get())
        inside.append(dict(scope["headers"])[b"x-request-id"].decode())
        await send({"type": "http.response.start", "status": 404, "headers": []})
        await send({"type": "http.response.body", "body": b""})

    async def ask(trusted: bool) -> str:
        sent: list[Message] = []

        async def send(message: Message) -> None:
            sent.append(message)

        async def receive() -> Message:
            return {"type": "http.request"}

        ids = RequestIdMiddleware(
            app, trusts_header=trusted, observe=lambda method, status, _s: seen.append((method, status))
        )
        await ids({"type": "http", "method": "GET", "headers": [(b"x-request-id", b"mine")]}, receive, send)
        return dict(sent[0]["headers"])[b"x-request-id"].decode()

    own = asyncio.run(ask(False))
    assert own != "mine" and inside == [own, own] and seen == [("GET", 404)]
    assert asyncio.run(ask(True)) == "mine" and REQUEST_ID.get() is None


class Ended(KeptProcess):
    """A place whose processes live so long, one after the other; None for one that cannot be started."""

    def keep(self, lives_s: list[float | None], monkeypatch: pytest.MonkeyPatch) -> list[float]:
        """The pauses before each of them, and before the next."""
        clock, lives, pauses = [100.0], iter(lives_s), list[float]()

        def run() -> None:
            if (lived_s := next(lives)) is None:
                raise OSError("no more processes")
            clock[0] += lived_s

        def wait(pause_s: float) -> bool:
            pauses.append(pause_s)
            return len(pauses) > len(lives_s)

        monkeypatch.setattr(kept_process.time, "monotonic", lambda: clock[0])
        self._run_process, self.is_stopping = run, SimpleNamespace(wait=wait)  # type: ignore[assignment, method-assign]
        self._keep_running()
        return pauses


def build_ended() -> Ended:
    return Ended(print, lambda: ("any", ()), lambda _name, _status: True, short_life_s=5.0, patience_s=30.0)


def test_a_process_that_ends_soon_waits_longer_each_time(monkeypatch: pytest.MonkeyPatch) -> None:
    assert build_ended().keep([1.0] * 8, monkeypatch) == [0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0]
    assert build_ended().keep([1.0, 1.0, 5.0, 1.0], monkeypatch) == [0.0, 0.5, 1.0, 0.0, 0.5], "it lived long enough"


def test_a_process_that_cannot_be_started_waits_too(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    assert build_ended().keep([None, None], monkeypatch) == [0.0, 0.5, 1.0]
    assert "cannot be started" in caplog.text and "no more processes" in caplog.text


def test_a_process_is_started_again_and_ends_with_its_place(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    ended, looks, count = list[tuple[str, int]](), list[int](), itertools.count()
    codes = ["exit(4)", "exit(3)", "__import__('time').sleep(600.0)"]

    def conclude(name: str, status: int) -> bool:
        ended.append((name, status))
        return status != 4

    kept = KeptProcess(
        exec, lambda: (f"leaver {(number := next(count))}", (codes[min(number, 2)],)), conclude,
        short_life_s=0.0, patience_s=30.0, look=lambda: looks.append(1),
    )  # fmt: skip
    kept.start()
    wait_until(lambda: kept.starts == 3)
    process = kept.process
    kept.stop()
    assert process is not None and process.exitcode == -15 and kept.process is None and looks
    assert ended == [("leaver 0", 4), ("leaver 1", 3)], "one that was told to end is not concluded"
    levels = {record.getMessage(): record.levelno for record in caplog.records if "ended with" in record.getMessage()}
    assert levels == {
        "The process leaver 0 ended with status 4.": logging.INFO,
        "The process leaver 1 ended with status 3.": logging.WARNING,
    }
