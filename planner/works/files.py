"""Runs as files: a log (CSV with the columns of `headland diagnose`) and what is known of it beside (JSON)."""

from __future__ import annotations

import json
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from fields.reading import read_text, shown
from planner.works.record import COUNTERS, Array, Driven
from reports.work_results import Figures
from vehicle.measured.errors import LogError

VERSION, VERSION_KEY = 1, "headland_run"
COLUMNS = ("time_s", "easting_m", "northing_m", "heading_deg", "speed_mps", "implement")
FORMATS = ("%.3f", "%.3f", "%.3f", "%.2f", "%.3f", "%d")
HEADING = "heading_deg is the course over ground: driven backwards it is turned by 180 degrees; there is no steering"
LONGEST = 24


def stems(runs: Sequence[Driven]) -> list[str]:
    """A name without an ending for the files of every run: day, field and log, each once."""
    found: list[str] = []
    for run in runs:
        parts = [run.start[:10], _plain(run.field), _plain(run.name)]
        stem = "_".join(dict.fromkeys(part for part in parts if part)) or "run"
        again, number = stem, 2
        while again.lower() in {one.lower() for one in found}:
            again, number = f"{stem}-{number}", number + 1
        found.append(again)
    return found


def _plain(text: str) -> str:
    """Letters, digits and dashes of a name, as any file system takes them."""
    ascii_only = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    return re.sub(r"[^A-Za-z0-9]+", "-", ascii_only).strip("-")[:LONGEST].strip("-")


def csv_text(run: Driven) -> str:
    """The log: time, UTM position, course, speed and work state; what nobody logged has no column."""
    columns = [run.time_s, *run.xy.T, run.heading_deg, run.speed_mps, run.works]
    kept = [place for place, name in enumerate(COLUMNS) if name != "implement" or run.works_known]
    lines = [",".join(COLUMNS[place] for place in kept)]
    form = ",".join(FORMATS[place] for place in kept)
    lines += [form % row for row in zip(*(columns[place].tolist() for place in kept), strict=True)]
    return "\n".join(lines) + "\n"


def about_text(run: Driven, source: str, figures: Figures, notes: Sequence[str]) -> str:
    """What is known of a run beside its log, as JSON; `source` names the file it came from."""
    rings = [] if run.outline is None else [run.outline.exterior, *run.outline.interiors]
    told: dict[str, Any] = {
        VERSION_KEY: VERSION, "name": run.name, "field": run.field, "start": run.start, "form": run.form,
        "source": source, "crs": run.crs, "width_m": run.width_m, "works_known": run.works_known,
        "speed_logged": run.speed_logged, "counters": run.counters,
        "outline_m": [np.round(np.array(ring.coords)[:, :2], 3).tolist() for ring in rings],
        "outline_m2": run.outline_m2, "heading": HEADING, "notes": list(notes), "figures": asdict(figures),
    }  # fmt: skip
    return json.dumps(told, indent=1, allow_nan=False) + "\n"


def run_files(paths: Iterable[str | Path]) -> list[Path]:
    """The logs (CSV) of folders and files, in order, each once; raises LogError where one is no imported run."""
    found: dict[Path, None] = {}
    for one in map(Path, paths):
        if one.is_dir():
            inside = [each.with_suffix(".csv") for each in sorted(one.glob("*.json")) if _is_run(each)]
            if not inside:
                raise LogError(f"{shown(one)} holds no imported run; make some: headland logs import FILES -o {one}.")
            found |= dict.fromkeys(inside)
        elif not one.exists():
            raise LogError(f"There is no file or folder {shown(one)}; check its name.")
        elif not one.with_suffix(".json").is_file():
            raise LogError(f"{shown(one)} has no {one.stem}.json beside it; import it with headland logs import.")
        else:
            found[one.with_suffix(".csv")] = None
    return list(found)


def read_runs(paths: Iterable[str | Path]) -> list[Driven]:
    """All runs of folders and files, each under a name of its own: its log's, with the folder where two share it."""
    files = run_files(paths)
    alike = Counter(path.stem for path in files)
    return [
        run if alike[path.stem] == 1 else replace(run, name=path.with_suffix("").as_posix())
        for path, run in ((path, read_run(path)) for path in files)
    ]


def _is_run(path: Path) -> bool:
    with path.open("rb") as stream:
        return f'"{VERSION_KEY}"'.encode() in stream.read(200)


def read_run(path: Path) -> Driven:
    """One run from its two files; raises LogError."""
    told = _told(path.with_suffix(".json"))
    table = _table(path)
    try:
        rings = [np.array(ring, dtype=np.float64) for ring in told.get("outline_m") or ()]
        return Driven(
            name=path.stem, form=str(told["form"]), crs=str(told["crs"]), time_s=table["time_s"],
            xy=np.column_stack([table["easting_m"], table["northing_m"]]), heading_deg=table["heading_deg"],
            speed_mps=table["speed_mps"], works=table.get("implement", np.zeros(len(table["time_s"]))) == 1.0,
            works_known="implement" in table, speed_logged=bool(told.get("speed_logged", True)),
            width_m=_number(told.get("width_m")), start=str(told.get("start", "")), field=str(told.get("field", "")),
            counters={name: float(value) for name, value in told.get("counters", {}).items() if name in COUNTERS},
            outline=shapely.Polygon(rings[0], rings[1:]) if rings else None,
            outline_m2=_number(told.get("outline_m2")), notes=tuple(map(str, told.get("notes", ()))),
        )  # fmt: skip
    except (KeyError, TypeError, ValueError, AttributeError, shapely.errors.GEOSException) as error:
        raise LogError(f"{shown(path.with_suffix('.json'))} is garbled ({error}); import the run again.") from None


def _told(path: Path) -> Mapping[str, Any]:
    text = read_text(path, "what headland logs import wrote", LogError)
    try:
        told = json.loads(text)
    except (ValueError, RecursionError):
        told = None
    if not isinstance(told, dict) or not isinstance(told.get(VERSION_KEY), int):
        raise LogError(f"{shown(path)} is not what headland logs import writes; import the run again.")
    if told[VERSION_KEY] > VERSION:
        raise LogError(f"{shown(path)} is of a newer Headland; use that, or import the run again.")
    return told


def _table(path: Path) -> dict[str, Array]:
    """Columns of a log by name; rows that are no numbers are refused with their line."""
    lines = read_text(path, "a log of headland logs import", LogError).splitlines()
    header = lines[0].split(",") if lines else []
    lacks = [name for name in COLUMNS[:-1] if name not in header]
    if lacks:
        raise LogError(f"{shown(path)} has no column {lacks[0]}; import the run again.")
    rows, where = [], f"{shown(path)}, line"
    for number, line in enumerate(lines[1:], start=2):
        try:
            rows.append([float(cell) for cell in line.split(",")])
        except ValueError:
            raise LogError(f"{where} {number}: {line[:40]!r} is no row of numbers; import the run again.") from None
        if len(rows[-1]) != len(header):
            raise LogError(f"{where} {number} has {len(rows[-1])} cells, not {len(header)}; import the run again.")
    table = np.array(rows)
    if len(table) < 2 or not np.isfinite(table).all() or (np.diff(table[:, header.index("time_s")]) <= 0.0).any():
        raise LogError(f"{shown(path)} has rows without numbers or out of order; import the run again.")
    return {name: table[:, place] for place, name in enumerate(header)}


def _number(value: Any) -> float | None:
    return None if value is None else float(value)
