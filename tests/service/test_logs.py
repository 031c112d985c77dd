"""Log lines: one line each with time, level and request, and the same one only so often."""

import asyncio
import io
import logging
import re
from typing import Any

from starlette.types import Message, Receive, Scope, Send

from planner.service.gateway.request_logs import REQUEST_ID, LogfmtFormatter, RepeatFilter, RequestIdMiddleware


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
