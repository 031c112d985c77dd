"""Runs as files: a log (CSV with the columns of `headland diagnose`) and its metadata (JSON)."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from fields.arrays import Floats
from fields.formats.guidance import simplify_to_ascii
from fields.geometry.coordinates import MAX_COORDINATE
from fields.text_files import quote_path, read_text
from planner.task_logs.runs.run_records import COUNTERS, ProjectedRun
from reports.task_logs.run_results import RunFigures
from vehicle.identification.errors import LogError

FORMAT_VERSION, VERSION_KEY = 1, "headland_run"
LOG_COLUMNS = {
    "time_s": "%.3f", "easting_m": "%.3f", "northing_m": "%.3f", "heading_deg": "%.2f", "speed_mps": "%.3f",
    "implement": "%d", "elevation_m": "%.3f",
}  # fmt: skip
"""Columns of a log, and how their numbers are written."""
OPTIONAL_COLUMNS = ("implement", "elevation_m")
HEADING_NOTE = "heading_deg is the course over ground, opposite to the heading in reverse; there is no steering angle"
MAX_NAME_LENGTH = 24
NO_VALUE = float("nan")


def choose_file_stems(runs: Sequence[ProjectedRun]) -> list[str]:
    """Unique file names without extension for the runs: day, field and log."""
    chosen: list[str] = []
    for run in runs:
        parts = [run.start[:10], _simplify_name(run.field), _simplify_name(run.name)]
        stem = "_".join(dict.fromkeys(part for part in parts if part)) or "run"
        candidate, number = stem, 2
        while candidate.lower() in {one.lower() for one in chosen}:
            candidate, number = f"{stem}-{number}", number + 1
        chosen.append(candidate)
    return chosen


def _simplify_name(text: str) -> str:
    """A name reduced to letters, digits and dashes, for any file system."""
    return re.sub(r"[^A-Za-z0-9]+", "-", simplify_to_ascii(text)).strip("-")[:MAX_NAME_LENGTH].strip("-")


def format_log_csv(run: ProjectedRun) -> str:
    """The log as CSV: time, UTM position, course, speed and, if logged, work state and height; no height is empty."""
    elevation_m = np.empty(0) if run.elevation_m is None else run.elevation_m
    values = [run.time_s, *run.xy.T, run.heading_deg, run.speed_mps, run.is_working, elevation_m]
    missing = {"implement": not run.has_work_state, "elevation_m": run.elevation_m is None}
    columns = {name: each.tolist() for name, each in zip(LOG_COLUMNS, values, strict=True) if not missing.get(name)}
    row_format = ",".join(LOG_COLUMNS[name] for name in columns)
    lines = [",".join(columns), *(row_format % row for row in zip(*columns.values(), strict=True))]
    return "\n".join(line.removesuffix("nan") for line in lines) + "\n"


def format_metadata(run: ProjectedRun, source: str, figures: RunFigures, notes: Sequence[str]) -> str:
    """The metadata of a run as JSON; `source` is the name of the original file."""
    rings = [] if run.outline is None else [run.outline.exterior, *run.outline.interiors]
    metadata: dict[str, Any] = {
        VERSION_KEY: FORMAT_VERSION,
        "name": run.name,
        "field": run.field,
        "start": run.start,
        "form": run.log_format,
        "source": source,
        "crs": run.crs,
        "width_m": run.width_m,
        "works_known": run.has_work_state,
        "speed_logged": run.has_logged_speed,
        "counters": run.counters,
        "outline_m": [np.round(np.array(ring.coords)[:, :2], 3).tolist() for ring in rings],
        "outline_m2": run.outline_m2,
        "heading": HEADING_NOTE,
        "notes": list(notes),
        "figures": asdict(figures),
    }
    return json.dumps(metadata, indent=1, allow_nan=False) + "\n"


def list_run_files(paths: Iterable[str | Path]) -> list[Path]:
    """The logs (CSV) of folders and files, in order, each once; raises LogError for anything but imported runs."""
    log_files: dict[Path, None] = {}
    for path in map(Path, paths):
        if path.is_dir():
            inside = []
            for metadata_path in sorted(path.glob("*.json")):
                with metadata_path.open("rb") as stream:
                    if f'"{VERSION_KEY}"'.encode() in stream.read(200):
                        inside.append(metadata_path.with_suffix(".csv"))
            if not inside:
                raise LogError(
                    f"{quote_path(path)} contains no imported run; import some: headland logs import FILES -o {path}."
                )
            log_files |= dict.fromkeys(inside)
        elif not path.exists():
            raise LogError(f"There is no file or folder {quote_path(path)}; check its name.")
        elif not path.with_suffix(".json").is_file():
            raise LogError(
                f"{quote_path(path)} has no {path.stem}.json beside it; import it with headland logs import."
            )
        else:
            log_files[path.with_suffix(".csv")] = None
    return list(log_files)


def load_imported_runs(paths: Iterable[str | Path]) -> list[ProjectedRun]:
    """All runs of folders and files with unique names: the name of the log, with its folder if two share it."""
    files = list_run_files(paths)
    stem_counts = Counter(path.stem for path in files)
    return [
        run if stem_counts[path.stem] == 1 else replace(run, name=path.with_suffix("").as_posix())
        for path, run in ((path, load_imported_run(path)) for path in files)
    ]


def load_imported_run(path: Path) -> ProjectedRun:
    """One run from its two files; raises LogError."""
    metadata = _load_metadata(path.with_suffix(".json"))
    table = _load_table(path)
    try:
        rings = [np.array(ring, dtype=np.float64) for ring in metadata.get("outline_m") or ()]
        if not all(np.isfinite(ring).all() for ring in rings):
            raise ValueError("outline_m contains values that are not finite")
        return ProjectedRun(
            name=path.stem,
            log_format=str(metadata["form"]),
            crs=str(metadata["crs"]),
            time_s=table["time_s"],
            xy=np.column_stack([table["easting_m"], table["northing_m"]]),
            heading_deg=table["heading_deg"],
            speed_mps=table["speed_mps"],
            is_working=table.get("implement", np.zeros(len(table["time_s"]))) == 1.0,
            has_work_state="implement" in table,
            has_logged_speed=bool(metadata.get("speed_logged", True)),
            width_m=_parse_number(metadata.get("width_m")),
            start=str(metadata.get("start", "")),
            field=str(metadata.get("field", "")),
            counters={name: float(value) for name, value in metadata.get("counters", {}).items() if name in COUNTERS},
            outline=shapely.Polygon(rings[0], rings[1:]) if rings else None,
            outline_m2=_parse_number(metadata.get("outline_m2")),
            notes=tuple(map(str, metadata.get("notes", ()))),
            elevation_m=table.get("elevation_m"),
        )
    except (KeyError, TypeError, ValueError, AttributeError, shapely.errors.GEOSException) as error:
        raise LogError(f"{quote_path(path.with_suffix('.json'))} is garbled ({error}); import the run again.") from None


def _load_metadata(path: Path) -> Mapping[str, Any]:
    text = read_text(path, "the metadata of an imported run", LogError)
    try:
        metadata = json.loads(text)
    except (ValueError, RecursionError):
        metadata = None
    if not isinstance(metadata, dict) or not isinstance(metadata.get(VERSION_KEY), int):
        raise LogError(f"{quote_path(path)} is not the metadata of an imported run; import the run again.")
    if metadata[VERSION_KEY] > FORMAT_VERSION:
        raise LogError(f"{quote_path(path)} is from a newer version of Headland; update, or import the run again.")
    return metadata


def _load_table(path: Path) -> dict[str, Floats]:
    """Columns of a log by name; raises LogError with the line of a row that is not numbers."""
    lines = read_text(path, "a log of headland logs import", LogError).splitlines()
    header = lines[0].split(",") if lines else []
    missing_columns = [name for name in LOG_COLUMNS if name not in (*header, *OPTIONAL_COLUMNS)]
    if missing_columns:
        raise LogError(f"{quote_path(path)} has no column {missing_columns[0]}; import the run again.")
    rows, label = [], f"{quote_path(path)}, line"
    for number, line in enumerate(lines[1:], start=2):
        try:
            rows.append([float(cell) if cell else NO_VALUE for cell in line.split(",")])
        except ValueError:
            raise LogError(f"{label} {number}: {line[:40]!r} is not a row of numbers; import the run again.") from None
        if len(rows[-1]) != len(header):
            raise LogError(f"{label} {number} has {len(rows[-1])} cells, not {len(header)}; import the run again.")
    table = np.array(rows)
    needed = [index for index, name in enumerate(header) if name != "elevation_m"]
    if (
        len(table) < 2
        or not np.isfinite(table[:, needed]).all()
        or (np.diff(table[:, header.index("time_s")]) <= 0.0).any()
    ):
        raise LogError(f"{quote_path(path)} has rows without numbers or out of order; import the run again.")
    if (np.abs(table[:, [header.index("easting_m"), header.index("northing_m")]]) > MAX_COORDINATE).any():
        raise LogError(f"{quote_path(path)} has a position beyond {MAX_COORDINATE:g} m; import the run again.")
    return {name: table[:, index] for index, name in enumerate(header)}


def _parse_number(value: Any) -> float | None:
    return None if value is None else float(value)
