"""The files that a request names, kept as they were when it was made: names only, never paths.

Files of a kind lie in a folder of that name while a job works: "field/north.geojson", "farm/own.toml" with the tractors
it names beside it. What a file of the farm or the day names is looked for among the uploaded files alone.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from fields.samples_index import sample_names
from planner.service.errors import MissingError, ServiceError
from planner.service.jobs.requests import DayRequest, DiagnosisRequest, PlanRequest, Request
from planner.service.store import Store
from planner.service.store.files import SUFFIXES
from vehicle.tractor import tractor_names

DAY_FILE = "day/day.toml"
EXAMPLE = "example"  # of a farm, in a day
PATH_MARKS = "/\\:\0"

Inputs = dict[str, str]
"""Files of a request: where each lies while it is worked on, and the SHA-256 of its bytes."""


class Gathering:
    """Gathers the files of one request out of a store."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self.inputs: Inputs = {}

    def file(self, kind: str, name: str, parameter: str, folder: str = "", called: str = "") -> str:
        """Add an uploaded file; where it will lie. Raises ServiceError about the parameter."""
        try:
            row = self._store.file(kind, _stem(kind, name))
        except MissingError as error:
            raise ServiceError(str(error), parameter=parameter) from None
        place = f"{folder or kind}/{called or row.name + row.suffix}"
        self.add(kind, place, row.sha256, parameter)
        return place

    def add(self, kind: str, place: str, sha256: str, parameter: str) -> None:
        """Add bytes at a place; a farm brings the tractor files that it names."""
        self.inputs[place] = sha256
        if kind == "farm":
            self._named_in(sha256, place.partition("/")[0], parameter, _tractors)

    def field(self, name: str, parameter: str) -> str:
        """A sample as it is, or an uploaded field with what stands behind its "#"."""
        stem, mark, key = name.partition("#")
        return name if stem in sample_names() else self.file("field", stem, parameter) + mark + key

    def said(self, name: str) -> dict[str, Any]:
        """How an uploaded field is to be read, as was said when it was uploaded."""
        stem = name.partition("#")[0]
        return {} if stem in sample_names() else dict(self._store.file("field", _stem("field", stem)).options)

    def tractor(self, name: str, parameter: str) -> str:
        """A tractor of the package as it is, or an uploaded one."""
        return name if name in tractor_names() else self.file("tractor", name, parameter)

    def day(self, text: str) -> None:
        """The text of a day, and the files that it names."""
        sha256 = self._store.blobs.put(text.encode())
        self.inputs[DAY_FILE] = sha256
        self._named_in(sha256, "day", "day", _of_day)

    def _named_in(
        self, sha256: str, folder: str, parameter: str, names: Callable[[Mapping[str, Any]], Iterator[tuple[str, str]]]
    ) -> None:
        """Files that a TOML file names, beside it under the names it has for them; what is no TOML names none."""
        try:
            values = tomllib.loads(self._store.blobs.get(sha256).decode("utf-8-sig"))
        except (ValueError, RecursionError):
            return
        for kind, name in names(values):
            if f"{folder}/{name}" == DAY_FILE:
                sentence = f"A {kind} of the day is called {name!r} as the day is; upload it under another name."
                raise ServiceError(sentence, parameter=parameter)
            self.file(kind, name, parameter, folder, name)


def gathered(store: Store, request: Request) -> tuple[dict[str, Any], Inputs]:
    """A request whose names are places in its folder, and the files to lay there; raises ServiceError."""
    found, values = Gathering(store), request.model_dump(exclude_unset=True, exclude_none=True, exclude={"name"})
    if _is_file(values.get("rain")):
        values["rain"] = found.file("table", values["rain"].strip(), "rain")
    if isinstance(request, PlanRequest):
        values["field"] = found.field(request.field, "field")
        values = found.said(request.field) | values
        if request.gnss_table is not None:
            values["gnss_table"] = found.file("table", request.gnss_table, "gnss_table")
        if request.farm is not None:
            values["farm"] = found.file("farm", request.farm, "farm")
        if "tractor" in values and not _of_farm(store, request):
            values["tractor"] = found.tractor(request.tractor, "tractor")
    elif isinstance(request, DayRequest):
        found.day(request.day)
        values["day"] = DAY_FILE
        if request.farm is not None:
            values["farm"] = request.farm if request.farm == EXAMPLE else found.file("farm", request.farm, "farm")
    elif isinstance(request, DiagnosisRequest):
        values["logs"] = [found.file("log", name, "logs") for name in request.logs]
        values["tractor"] = found.tractor(request.tractor, "tractor")
    return values, found.inputs


def lay(store: Store, inputs: Mapping[str, str], folder: Path) -> None:
    """Put the files of a request into a folder."""
    for place, sha256 in inputs.items():
        path = folder / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(store.blobs.get(sha256))


def _of_farm(store: Store, request: PlanRequest) -> bool:
    """Whether a tractor is one of the farm's: not of the package, not uploaded, and nothing that could be a path."""
    known = {each.name for each in store.files("tractor")} | set(tractor_names())
    if request.farm is None or any(mark in request.tractor for mark in PATH_MARKS):
        return False
    return _stem("tractor", request.tractor) not in known


def _stem(kind: str, name: str) -> str:
    """A name without the ending of its kind."""
    return next((name.removesuffix(end) for end in SUFFIXES[kind] if name.endswith(end)), name)


def _tractors(values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Tractor files that a farm names."""
    for name in _texts(values.get("tractors"), "file"):
        if name not in tractor_names():
            yield "tractor", name


def _of_day(values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Fields, the farm and the table of rain that a day names."""
    for name in _texts(values.get("fields"), "file"):
        if name.partition("#")[0] not in sample_names():
            yield "field", name.partition("#")[0]
    farm = values.get("farm")
    if isinstance(farm, str) and farm != EXAMPLE:
        yield "farm", farm
    rain = values.get("rain")
    if isinstance(rain, str) and _is_file(rain):
        yield "table", rain.strip()


def _texts(tables: Any, key: str) -> Iterator[str]:
    for each in tables if isinstance(tables, list) else ():
        if isinstance(each, Mapping) and isinstance(each.get(key), str):
            yield each[key]


def _is_file(rain: Any) -> bool:
    """Whether rain is told by a table, as planner.chance.rain has it."""
    return isinstance(rain, str) and rain.strip().lower().endswith(".csv")
