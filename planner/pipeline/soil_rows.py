"""What a diagnosis taught of a soil, as a line of the user's table of soils (vehicle.model.soil)."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path

from fields.text_files import count_noun, lower_first, read_table
from planner.errors import RequestError, mark_parameter
from planner.evaluation.field_physics import NAME_MARK, split_soil_name
from reports.diagnosis.sentences import describe_unsaved
from vehicle.errors import VehicleError
from vehicle.identification.diagnosis.results import CONSTANT_LAW, LIKELY, NAMED, Diagnosis, Finding
from vehicle.model.effects import DRIVE_LINE_SLIP, MAX_PLAUSIBLE_SLIP, get_effect
from vehicle.model.soil import HIGH, LOW, SOIL_EFFECTS, MeasuredEffects, Soil, load_soils

USUAL_TABLE = Path("soils.csv")
DIGITS = 4  # of a value: its interval is far wider


@dataclass(frozen=True)
class SoilLine:
    """Where a line is added: the table (made if it is missing), the name of the soil and its moisture."""

    path: Path
    name: str
    moisture_pct: float


def parse_soil_line(soil: str, moisture_pct: float | None, ground: str) -> SoilLine:
    """The line that a user asks for: "soils.csv#north" at 22 %, or a name, whose table is USUAL_TABLE.

    Raises:
        RequestError: no name or no possible moisture, or the table has that line, or others of the soil that do not go
            together with one measured on `ground`.
        VehicleError: the table exists and has a fault.
    """
    name, table = split_soil_name(soil)
    path = table or USUAL_TABLE
    option = mark_parameter("save_soil")
    if not name.strip():
        raise RequestError(
            f"{option} {soil} does not name the soil; write {path}{NAME_MARK}NAME.", parameter="save_soil"
        )
    if moisture_pct is None:
        raise RequestError(
            f"{option} {soil} needs the moisture of the logs; add {mark_parameter('moisture_pct')}, in % of dry "
            "weight.",
            parameter="moisture_pct",
        )
    if not 0.0 <= moisture_pct <= 100.0:
        raise RequestError(
            f"{mark_parameter('moisture_pct')} {moisture_pct:g} is no moisture of a soil; give % of dry weight, from 0 "
            "to 100.",
            parameter="moisture_pct",
        )
    name = name.strip()
    for row in load_soils(path).get(name, ()) if path.exists() else ():
        if row.moisture_pct == moisture_pct:
            raise RequestError(
                f"{path} has the soil {name!r} at {moisture_pct:g} % moisture already; give another name or moisture, "
                "or delete that line.",
                parameter="save_soil",
            )
        if row.moisture_pct is None or row.ground != ground:
            other = "without a moisture" if row.moisture_pct is None else f"on {row.ground or 'a cone index'}"
            raise RequestError(
                f"{path} has the soil {name!r} {other}, which cannot be interpolated with one measured on {ground}; "
                "give another name.",
                parameter="save_soil",
            )
    return SoilLine(path, name, moisture_pct)


def build_soil_row(diagnosis: Diagnosis, line: SoilLine) -> Soil:
    """What logs taught of a soil: named effects of the ground that are the same all over the logs.

    Raises:
        RequestError: there is none, or it may not be saved.
    """
    if not diagnosis.is_savable:
        raise RequestError(f"{line.path} is left as it is: {lower_first(describe_unsaved(diagnosis))}")
    values: dict[str, float] = {}
    for finding in diagnosis.findings:
        if not _is_of_soil(finding):
            continue
        key = get_effect(finding.id).size.name
        assert finding.value is not None
        values[finding.id] = round(finding.value[key], DIGITS)
        low, high = (finding.interval or {}).get(key, (math.inf, math.inf))
        if math.isfinite(low) and math.isfinite(high):
            values |= {finding.id + LOW: round(low, DIGITS), finding.id + HIGH: round(high, DIGITS)}
    if not values:
        likely = [
            get_effect(one.id).label for one in diagnosis.findings if one.id in SOIL_EFFECTS and one.status == LIKELY
        ]
        known = ", ".join(get_effect(name).label for name in SOIL_EFFECTS)
        why = (
            f"by these logs {' and '.join(likely)} is likely, and not certain; add more of them, at several speeds."
            if likely
            else f"these logs name nothing of a soil ({known}); drive at several speeds, working and not."
        )
        raise RequestError(f"{line.path} is left as it is: {why}")
    runs = count_noun(len(diagnosis.names), "run")
    source = f"diagnosis of {runs} ({diagnosis.minutes:.0f} min) of {diagnosis.tractor.name}"
    cells = {"name": line.name, "moisture_pct": line.moisture_pct, "ground": diagnosis.ground, "source": source}
    return Soil.model_validate(cells | values)


def _is_of_soil(finding: Finding) -> bool:
    """Whether a finding is a sure and constant effect that a soil can have."""
    if finding.id not in SOIL_EFFECTS or finding.status != NAMED or not finding.value:
        return False
    if finding.law is not None and finding.law.kind != CONSTANT_LAW:
        return False
    is_slip = finding.id == "wheel_slip"
    return not is_slip or -DRIVE_LINE_SLIP < finding.value["ratio"] < MAX_PLAUSIBLE_SLIP


def format_soil_table(row: Soil, path: Path) -> str:
    """The table with the line added; its other lines hold what they held, with commas between cells and the columns
    that the new one needs.

    Raises VehicleError for a line with more cells than the table has columns.
    """
    new = {name: f"{value}" for name, value in row.model_dump(exclude_none=True, exclude_defaults=True).items()}
    columns, rows = list[str](), list[dict[str, str]]()
    if path.exists():
        table = read_table(path, "a CSV table", VehicleError)
        columns += table.header
        rows += table.list_named_cells()
    known = sorted(Soil.model_fields, key=lambda name: name in MeasuredEffects.model_fields)
    columns += [name for name in known if name in new and name not in columns]
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows([*rows, new])
    return out.getvalue()
