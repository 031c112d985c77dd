"""What of a plan was written as guidance and what was left out: for the terminal and as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from rich.console import Group, RenderableType

from reports.fitting import Column, FittedTable, sentence
from reports.guidance.cutting import MOST_STRETCHES, OFF_M
from reports.guidance.forms import Written
from reports.guidance.lines import Guidance, Line
from reports.guidance.names import DESIGNATOR_BYTES, plain

WHY = "nothing that a terminal steers by; headland show lists it"
CURVES_WHY = (
    f"some terminals refuse them, and these have more than {MOST_STRETCHES} straight stretches; --curves writes them"
)
CURVES_WARNING = "Curves are written as asked; some terminals refuse a file that has any, so keep one without at hand."


def left_out(guidance: Guidance, written: Written) -> list[dict[str, Any]]:
    """What is not in the files: what, how many, and why."""
    form = written.form
    found: list[dict[str, Any]] = []
    if written.left:
        found.append({
            "what": "curves", "count": len(written.left), "why": CURVES_WHY,
        })  # fmt: skip
    parts = {
        "headland": len(guidance.inside_headland),
        "entrance": int(guidance.entrance is not None),
        "obstacles": len(guidance.obstacles),
        "holes of the boundary": 0 if guidance.boundary is None else len(guidance.boundary.rings) - 1,
    }
    for what, count in parts.items():
        if what in form.lacks and count:
            found.append({"what": what, "count": count, "why": f"{form.words} has no place for it"})
    return found + [{"what": what, "count": count, "why": WHY} for what, count in guidance.left_out]


def remarks(guidance: Guidance, written: Written) -> list[str]:
    """What a person should know before the files are used."""
    found = []
    if guidance.boundary is None:
        found.append(
            "The plan was saved without the outline of its field, so there is no boundary; plan and save again."
        )
    if written.cut:
        places = {line.place for line in written.cut}
        stretches = sum(line.place in places for line in written.lines)
        found.append(
            f"Curves cut into straight lines: {len(places)}, into {stretches} lines no farther off than "
            f"{OFF_M * 100:.0f} cm (letters behind their numbers); --curves writes them whole."
        )
    if written.curves and not written.form.curves:
        found.append(CURVES_WARNING)
    cut = written.form.name.startswith("isoxml") and len(plain(guidance.field)) > DESIGNATOR_BYTES
    if cut:
        found.append(f"The name of the field is cut to {DESIGNATOR_BYTES} letters, as ISOXML wants it.")
    return found


def export_table(guidance: Guidance, written: Written, files: Sequence[str]) -> RenderableType:
    """Lines by tractor, the files, and what was left out."""
    columns = (
        Column("Tractor"), Column("Lines"), Column("Straight"), Column("Curves"), Column("Length (m)", "m", drop=1),
        Column("From", words=True, drop=2), Column("To", words=True, drop=2),
    )  # fmt: skip
    rows = []
    for tractor in guidance.tractors:
        lines = [line for line in written.lines if line.tractor == tractor.number]
        straight = sum(line.straight for line in lines)
        ends = (lines[0].name, lines[-1].name) if lines else ("", "")
        length = f"{sum(line.length_m for line in lines):.0f}"
        rows.append((str(tractor.number), str(len(lines)), str(straight), str(len(lines) - straight), length, *ends))
    told = [f"Written as {written.form.words}: {_listed(files)}."]
    told += [f"Left out: {one['what']} ({one['count']}): {one['why']}." for one in left_out(guidance, written)]
    return Group(FittedTable(columns, tuple(rows)), *(sentence(one) for one in told))


def _listed(files: Sequence[str]) -> str:
    return ", ".join(files) if len(files) <= 4 else f"{', '.join(files[:3])} and {len(files) - 3} more"


def export_json(guidance: Guidance, written: Written, files: Sequence[str]) -> str:
    """``format``, ``field``, ``area_ha``, ``files``, ``lines`` in driving order (tractor after tractor, those that were
    left out too, ``written`` false) and ``left_out`` (``what``, ``count``, ``why``) as JSON text."""
    kept = {line.place for line in written.lines}
    content = {
        "format": written.form.name,
        "field": guidance.field,
        "area_ha": None if guidance.boundary is None else round(guidance.area_m2 / 1e4, 6),
        "files": list(files),
        "lines": [_entry(line, line.place in kept) for line in guidance.lines],
        "left_out": left_out(guidance, written),
    }
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _entry(line: Line, kept: bool) -> dict[str, Any]:
    return {
        "name": line.name,
        "tractor": line.tractor,
        "order": line.order,
        "kind": line.kind,
        "what": line.words,
        "straight": line.straight,
        "bearing_deg": round(line.bearing_deg, 6),
        "length_m": round(line.length_m, 3),
        "written": kept,
    }
