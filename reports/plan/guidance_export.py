"""Guidance files of a plan: the formats by name, writing them, and what was written and left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import Group, RenderableType

from fields.errors import mark_parameter
from fields.formats.format_records import list_records
from fields.formats.guidance import (
    MAX_DESIGNATOR_BYTES,
    MAX_SEGMENTS,
    FileContents,
    GuidanceFormat,
    GuidedLine,
    PlanGuidance,
    cut_curves_into_segments,
    simplify_to_ascii,
)
from fields.geometry.arithmetic import CURVE_M
from reports.common.rendering import ReportError, format_json, pick_values
from reports.common.text_tables import FittedTable, TableColumn, format_sentence

GUIDANCE_FORMATS = list_records(GuidanceFormat, first=("isoxml", "agopengps", "kml", "shapefile"))
"""In the order in which they are offered."""


@dataclass(frozen=True, eq=False)
class GuidanceFiles:
    """Guidance files: `lines` are in them, `unwritten_curves` are not, `cut_lines` are curves cut into segments."""

    format: GuidanceFormat
    files: FileContents
    lines: tuple[GuidedLine, ...]
    unwritten_curves: tuple[GuidedLine, ...]
    cut_lines: tuple[GuidedLine, ...] = ()

    @property
    def is_single_file(self) -> bool:
        """Whether the format is one file, and there is only one."""
        return bool(self.format.extension) and len(self.files) == 1


def find_guidance_format(name: str) -> GuidanceFormat | None:
    """The format of this name, in upper or lower case; None for none."""
    return next((form for form in GUIDANCE_FORMATS if form.name == name.strip().lower()), None)


def write_guidance(
    guidance: PlanGuidance, guidance_format: GuidanceFormat, include_curves: bool | None = None
) -> GuidanceFiles:
    """The files of a guidance in a format, with curves if `include_curves`; None for the default of the format.

    Raises ReportError where there is no line to write.
    """
    has_curves = guidance_format.takes_curves if include_curves is None else include_curves
    writable = guidance if has_curves else cut_curves_into_segments(guidance)
    if not writable.lines:
        reason = f"all of them are curves; add {mark_parameter('curves')}" if guidance.lines else "the plan has none"
        raise ReportError(f"There is no line to write as {guidance_format.title}: {reason}.")
    written_positions = {line.driving_position for line in writable.lines}
    whole_curves = {line.driving_position for line in writable.lines if not line.is_straight}
    unwritten = tuple(line for line in guidance.lines if line.driving_position not in written_positions)
    cut_lines = tuple(
        line
        for line in guidance.lines
        if not line.is_straight and line.driving_position in written_positions - whole_curves
    )
    return GuidanceFiles(guidance_format, _write_files(writable, guidance_format), writable.lines, unwritten, cut_lines)


def _write_files(guidance: PlanGuidance, guidance_format: GuidanceFormat) -> FileContents:
    """The files; where a format has no tractors, those of each tractor are in a place of their own."""
    if not guidance_format.per_tractor or len(guidance.tractors) == 1:
        return guidance_format.write(guidance)
    contents: dict[str, bytes] = {}
    for tractor_guidance in (each for each in guidance.list_tractor_guidances() if each.lines):
        tractor = f"T{tractor_guidance.tractors[0].number}"
        for path, content in guidance_format.write(tractor_guidance).items():
            own_path = f"{tractor}{guidance_format.extension}" if guidance_format.extension else f"{tractor}/{path}"
            contents[path if guidance_format.names_tractors else own_path] = content
    return contents


def list_unwritten_content(guidance: PlanGuidance, written: GuidanceFiles) -> list[dict[str, Any]]:
    """What is not in the files: kind, number and reason, of lines their length (m) too."""
    guidance_format = written.format
    entries = _list_curves(
        written.unwritten_curves,
        f"some terminals refuse curves, and these have more than {MAX_SEGMENTS} straight segments; --curves writes "
        "them",
    )
    parts = {
        "headland": len(guidance.headland_interior),
        "entrance": int(guidance.entrance is not None),
        "obstacles": len(guidance.obstacles),
        "holes of the boundary": 0 if guidance.boundary is None else len(guidance.boundary.rings) - 1,
    }
    for part, count in parts.items():
        if part in guidance_format.unsupported_parts and count:
            entries.append({"what": part, "count": count, "why": f"{guidance_format.title} cannot hold it"})
    reason = "not for guidance; headland show lists them"
    return entries + [{"what": part, "count": count, "why": reason} for part, count in guidance.left_out]


def list_content_for_newer_terminals(written: GuidanceFiles) -> list[dict[str, Any]]:
    """What is in the files but cannot be read by terminals of the older format: kind, number, reason and length (m)."""
    older = find_guidance_format(written.format.older)
    if older is None:
        return []
    curves = tuple(line for line in written.lines if not line.is_straight)
    reason = f"{older.title} has straight lines only; --to {older.name} writes what its terminals read"
    return _list_curves(curves, reason)


def _list_curves(curves: Sequence[GuidedLine], reason: str) -> list[dict[str, Any]]:
    """An entry for curves, if there are any."""
    if not curves:
        return []
    length_m = round(sum(line.length_m for line in curves), 1)
    return [{"what": "curves", "count": len(curves), "why": reason, "length_m": length_m}]


def collect_remarks(guidance: PlanGuidance, written: GuidanceFiles) -> list[str]:
    """Remarks to read before the files are used."""
    sentences = []
    if guidance.boundary is None:
        sentences.append(
            "The plan was saved without the outline of its field, so there is no boundary; plan and save it again."
        )
    if written.cut_lines:
        cut_positions = {line.driving_position for line in written.cut_lines}
        segment_count = sum(line.driving_position in cut_positions for line in written.lines)
        sentences.append(
            f"Curves cut into straight lines: {len(cut_positions)}, into {segment_count} lines within "
            f"{CURVE_M * 100:.0f} cm (letters after their numbers); --curves writes them whole."
        )
    if not written.format.takes_curves and not all(line.is_straight for line in written.lines):
        sentences.append("The files have curves, which some terminals refuse; keep a version without them at hand.")
    is_long = len(simplify_to_ascii(guidance.field)) > MAX_DESIGNATOR_BYTES
    if is_long and written.format.name.startswith("isoxml"):
        sentences.append(
            f"The name of the field is cut to {MAX_DESIGNATOR_BYTES} letters, the most that ISOXML allows."
        )
    return sentences


def build_export_table(guidance: PlanGuidance, written: GuidanceFiles) -> RenderableType:
    """A table of lines by tractor, and what was left out."""
    columns = (
        *map(TableColumn, ("Tractor", "Lines", "Straight", "Curves")), TableColumn("Length (m)", "m", drop_order=1),
        TableColumn("From", is_text=True, drop_order=2), TableColumn("To", is_text=True, drop_order=2),
    )  # fmt: skip
    rows = []
    for tractor in guidance.tractors:
        lines = [line for line in written.lines if line.tractor == tractor.number]
        straight_count = sum(line.is_straight for line in lines)
        counts = (tractor.number, len(lines), straight_count, len(lines) - straight_count)
        ends = (lines[0].name, lines[-1].name) if lines else ("", "")
        rows.append((*map(str, counts), f"{sum(line.length_m for line in lines):.0f}", *ends))
    sentences = [
        f"Not for older terminals: {_describe_content(one)}." for one in list_content_for_newer_terminals(written)
    ]
    sentences += [f"Left out: {_describe_content(one)}." for one in list_unwritten_content(guidance, written)]
    return Group(FittedTable(columns, tuple(rows)), *(format_sentence(one) for one in sentences))


def _describe_content(entry: dict[str, Any]) -> str:
    """``curves (9, 1071 m): why``."""
    length = f", {entry['length_m']:.0f} m" if "length_m" in entry else ""
    return f"{entry['what']} ({entry['count']}{length}): {entry['why']}"


def export_json(guidance: PlanGuidance, written: GuidanceFiles, files: Sequence[str]) -> str:
    """``format``, ``field``, ``boundary_ha``, ``files``, ``lines``, ``left_out`` and ``not_for_older`` as JSON.

    Lines are in driving order, tractor by tractor; those that are not in the files have ``written`` false. ``left_out``
    and ``not_for_older`` (what terminals of an older version cannot read) have ``what``, ``count``, ``why`` and, of
    lines, ``length_m``.
    """
    written_positions = {line.driving_position for line in written.lines}
    content = {
        "format": written.format.name,
        "field": guidance.field,
        "boundary_ha": None if guidance.boundary is None else round(guidance.area_m2 / 1e4, 6),
        "files": list(files),
        "lines": [
            {
                **pick_values(line, ("name", "tractor", "order", "kind")),
                "what": line.description,
                "straight": line.is_straight,
                "bearing_deg": round(line.bearing_deg, 6),
                "length_m": round(line.length_m, 3),
                "written": line.driving_position in written_positions,
            }
            for line in guidance.lines
        ],
        "left_out": list_unwritten_content(guidance, written),
        "not_for_older": list_content_for_newer_terminals(written),
    }
    return format_json(content, is_ascii=False)
