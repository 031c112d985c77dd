"""One confined reading, and its answer as JSON: {value}, {refused, parameter}, {memory} or {fault}."""

from __future__ import annotations

import json
import os
import signal
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from planner.service.sandbox.confinement import confine_process

MEMORY_ANSWER = b'{"memory": true}'
MOST_FAULT_CHARS = 4000


def list_readings() -> dict[str, Callable[..., Any]]:
    """All readings by name."""
    from planner.service.sandbox.file_summaries import SUMMARIES, UPLOAD_CHECKS
    from planner.service.sandbox.form_texts import FORMS
    from planner.service.sandbox.request_checks import REQUEST_CHECKS

    tables: dict[str, dict[str, Callable[..., Any]]] = {
        "check": REQUEST_CHECKS,
        "upload": UPLOAD_CHECKS,
        "summary": SUMMARIES,
        "form": FORMS,
    }
    return {f"{use} {kind}": read for use, table in tables.items() for kind, read in table.items()}


def load_libraries() -> None:
    """Load the libraries for reading, by summarising a sample field."""
    import pandas  # noqa: F401
    import pyogrio.raw  # noqa: F401
    import scipy.interpolate  # noqa: F401
    import tomlkit  # noqa: F401

    with suppress(ImportError):  # an extra, for GeoTIFFs
        import rasterio.windows  # noqa: F401
    from planner.evaluation import context  # noqa: F401
    from planner.service.sandbox.file_summaries import summarize_field, summarize_tractor
    from vehicle.identification.diagnosis import demo_logs  # noqa: F401
    from vehicle.identification.logs import reader  # noqa: F401
    from vehicle.model import gnss  # noqa: F401

    summarize_field("netherlands")
    summarize_tractor("eg105")


def read_confined(channel: int, request: dict[str, Any], libraries: list[Path], *, is_forked: bool = True) -> None:
    """Confine this process, read and write the answer; never returns."""
    code = 1
    try:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        open_descriptor = channel if is_forked else None
        confine_process(Path(request["folder"]), libraries, request["memory"], request["seconds"], open_descriptor)
        _write_all(channel, answer_request(request))
        code = 0
    except MemoryError:
        _write_all(channel, MEMORY_ANSWER)
    except BaseException as error:
        _write_all(
            channel, json.dumps({"fault": "".join(traceback.format_exception(error))[-MOST_FAULT_CHARS:]}).encode()
        )
    finally:
        os._exit(code)


def answer_request(request: dict[str, Any]) -> bytes:
    """Read; the answer as JSON."""
    from fields.errors import HeadlandError

    try:
        value = list_readings()[request["read"]](*request["arguments"], **request["options"])
    except HeadlandError as refusal:
        return json.dumps({"refused": str(refusal.args[0]), "parameter": refusal.parameter}).encode()
    return json.dumps({"value": value}).encode()


def _write_all(channel: int, content: bytes) -> None:
    remaining = memoryview(content)
    while remaining:
        remaining = remaining[os.write(channel, remaining) :]
