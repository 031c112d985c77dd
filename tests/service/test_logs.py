"""Log lines: one each with time, level and request, the same only so often; and when a kept process begins anew."""

import asyncio
import io
import logging
import re
from types import SimpleNamespace
from typing import Any

import pytest
from starlette.types import Message, Receive, Scope, Send

from planner.service import kept_process
from planner.service.gateway.request_logs import REQUEST_ID, LogfmtFormatter, RepeatFilter, RequestIdMiddleware
from planner.service.kept_process import KeptProcess


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


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A clock."""
    clock = [100.0]
    monkeypatch.setattr(kept_process.time, "monotonic", lambda: clock[0])
    return clock


def wait_after(kept: KeptProcess, now: list[float], lived_s: float, **how: Any) -> float:
    """Let a process live so long; returns the seconds until the next one is due."""
    kept.process, kept._changed_s = SimpleNamespace(exitcode=1), now[0]  # type: ignore[assignment]
    now[0] += lived_s
    assert kept.end_status == 1 and not kept.is_due
    kept.forget(**how)
    ended_s = now[0]
    while not kept.is_due:
        now[0] += 0.25
    return now[0] - ended_s


def test_a_process_that_ends_soon_waits_longer_each_time(now: list[float]) -> None:
    kept = KeptProcess("any", print, 5.0, 30.0)
    assert kept.is_due and kept.end_status is None
    assert [wait_after(kept, now, 1.0) for _ in range(8)] == [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0]
    assert wait_after(kept, now, 6.0) == 0.0, "it lived long enough"
    assert wait_after(kept, now, 1.0) == 0.5
    assert wait_after(kept, now, 1.0, is_fault=False) == 1.0, "that it was meant to end is only logged otherwise"


def test_a_process_that_cannot_be_started_waits_too(now: list[float], monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(**_options: Any) -> Any:
        raise OSError("no more processes")

    monkeypatch.setattr(kept_process.multiprocessing, "get_context", lambda _: SimpleNamespace(Process=refuse))
    kept = KeptProcess("any", print, 5.0, 30.0)
    with pytest.raises(OSError, match="no more processes"):
        kept.start()
    assert not kept.is_due and kept.process is None
    now[0] += kept_process.FIRST_PAUSE_S
    assert kept.is_due
