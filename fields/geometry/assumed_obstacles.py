"""What features without a role are: obstacles by default, unless their words, number or place say otherwise.

A pole that is driven over costs more than one that is driven round, so what lies in a field is an obstacle, and a
remark says so. Labels, samples and measurements are no obstacles, nor is what covers most of the field.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from fields.errors import MAX_LISTED, FieldError, join_first
from fields.feature_words import (
    ENTRANCE,
    GUIDANCE,
    NOTE,
    OBSTACLE,
    OVERHEAD_LINE,
    REFILL,
    Meaning,
    find_meaning,
    find_name,
    is_label,
)
from fields.geometry.arithmetic import MACHINE_WIDTH_M, NEAR_FIELD_M
from fields.geometry.coordinates import FieldFrame
from fields.geometry.field_lines import FENCE, clip_outline_to_line
from fields.geometry.obstacles import DEFAULT_WIDTH_M, LINE, MAX_OBSTACLE_M, POINT, Obstacle
from fields.geometry.overlays import unite_on_grid
from fields.raw_document import RawShape
from fields.text_files import count_noun

DEFAULT_SIZE_M = 1.0
"""Radius of a point, or width of a line, of which nothing else is known: a pole with the error of a map."""
ASSUMED_RADIUS_M = {
    "pylon": 3.0, "wind turbine": 5.0, "building": 5.0, "wood": 5.0, "pond": 5.0, "wet ground": 3.0, "silo": 3.0,
    "hole": 2.0, "hide": 2.0, "solar panel": 2.0, "tree": 1.5, "bush": 1.5,
}  # fmt: skip
"""Radii of points by kind where they are larger; assumed, rather too large than too small."""
MAX_SHORT_LINE_M = 10.0  # no guidance line is shorter
MAX_UNKNOWN_FEATURES = 20
"""More points in a field that nothing is known of are measurements; nobody draws so many obstacles without names."""
MAX_ENTRANCE_INSIDE_M = 5.0  # tolerance for entrances drawn by hand
UNKNOWN_KINDS = {POINT: "point", LINE: "line"}


@dataclass
class AssumedRoles:
    """Features of a field whose roles are assumed, the features left over, and remarks."""

    obstacles: list[Obstacle] = field(default_factory=list)
    places: dict[str, list[tuple[str, tuple[float, float]]]] = field(default_factory=lambda: {ENTRANCE: [], REFILL: []})
    fences: list[RawShape] = field(default_factory=list)
    guidance_lines: list[RawShape] = field(default_factory=list)
    unused: list[RawShape] = field(default_factory=list)
    ignored: dict[str, list[str]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def ignore(self, reason: str, name: str) -> None:
        """Remember a feature that is no obstacle."""
        self.ignored.setdefault(reason, []).append(name)

    def take_place(self, role: str, given: tuple[float, float] | None) -> tuple[float, float] | None:
        """The entrance or refill place that the file gives, else the only one by its name; with a note on others."""
        candidates = self.places[role]
        names = join_first([name for name, _ in candidates], MAX_LISTED)
        if candidates and given is not None:
            self.notes.append(f"Not used as {role}, as the file has one: {names}.")
        elif len(candidates) > 1:
            self.notes.append(f"Which is the {role} is unclear: {names}; choose one with --{role} LON,LAT.")
        elif candidates:
            self.notes.append(f"Taken as the {role} by its name: {names}.")
            return candidates[0][1]
        return given

    @property
    def remarks(self) -> list[str]:
        """Sentences on everything but obstacles."""
        parts = []
        for reason, labels in self.ignored.items():
            examples = join_first([label for label in labels if label.startswith("'")])
            parts.append(f"{count_noun(len(labels), reason)}{f' ({examples})' if examples else ''}")
        ignored = f"Without a role and no obstacles by their names or number, so not used: {', '.join(parts)}."
        return [*self.notes, *([ignored] if parts else [])]


@dataclass(frozen=True)
class _Candidate:
    """A feature without a role in local metres."""

    raw: RawShape
    geometry: shapely.Geometry
    meaning: Meaning
    name: str

    @property
    def label(self) -> str:
        """Its name, or its geometry."""
        return f"'{self.name}'" if self.name else f"a {self.raw.geometry_type}"

    @property
    def size_m(self) -> float:
        """Radius of a point or half the width of a line: its own, else that of its kind."""
        key = "radius_m" if self.raw.geometry_type == POINT else "width_m"
        value, kind = self.raw.properties.get(key), self.meaning.kind
        usual_m = ASSUMED_RADIUS_M if self.raw.geometry_type == POINT else DEFAULT_WIDTH_M
        is_given = isinstance(value, int | float) and not isinstance(value, bool) and 0.0 < value <= MAX_OBSTACLE_M
        size_m = float(value) if is_given and value is not None else usual_m.get(kind, DEFAULT_SIZE_M)
        return size_m if self.raw.geometry_type == POINT else 0.5 * size_m

    def build_obstacle(self) -> Obstacle:
        kind = self.meaning.kind or UNKNOWN_KINDS[self.raw.geometry_type]
        return Obstacle(kind, self.geometry, self.size_m, self.name, is_assumed=True)


def assume_roles(
    features: Sequence[RawShape],
    lines: Sequence[RawShape],
    frame: FieldFrame,
    shape: shapely.Polygon,
    field_names: Sequence[str],
    solid: Sequence[shapely.Geometry],
) -> AssumedRoles:
    """What features without a role are in a field.

    Args:
        features: points and lines without a role.
        lines: guidance lines; short ones of which the file does not say so are obstacles.
        frame: local frame of the field.
        shape: boundary of the field, metres.
        field_names: names of the fields of the file; points of this name are labels.
        solid: obstacles with a role; what lies within them is part of them.
    """
    roles = AssumedRoles()
    covered = unite_on_grid([*(shapely.Polygon(hole) for hole in shape.interiors), *solid])
    unknown: list[_Candidate] = []
    for raw in features:
        candidate = _read_candidate(raw, frame)
        if candidate is None or not _assign_candidate(candidate, roles, shape, covered, field_names, unknown):
            roles.unused.append(raw)
    short = {number: one for number, line in enumerate(lines) if (one := _read_short_line(line, frame, shape))}
    if len(unknown) + len(short) > MAX_UNKNOWN_FEATURES:
        for candidate in unknown:
            roles.ignore("measurement", candidate.label)
        unknown, short = [], {}
    roles.obstacles += [one.build_obstacle() for one in (*unknown, *short.values())]
    roles.guidance_lines += [line for number, line in enumerate(lines) if number not in short]
    return roles


def _read_candidate(raw: RawShape, frame: FieldFrame) -> _Candidate | None:
    """A feature in local metres; None if its coordinates cannot be used."""
    if raw.geometry_type not in UNKNOWN_KINDS:
        return None
    try:
        points = frame.read_points(raw, "")
    except FieldError:
        return None
    if not np.isfinite(points).all() or (raw.geometry_type == LINE and len(np.unique(points, axis=0)) < 2):
        return None
    geometry = shapely.Point(points[0]) if raw.geometry_type == POINT else shapely.LineString(points)
    return _Candidate(raw, geometry, find_meaning(raw.properties), find_name(raw.properties))


def _read_short_line(line: RawShape, frame: FieldFrame, shape: shapely.Polygon) -> _Candidate | None:
    """A line of at most MAX_SHORT_LINE_M in the field that nothing but a name says to be a guidance line."""
    if line.properties.get("role"):
        return None
    name = line.keys[-1] if line.keys else ""
    candidate = _read_candidate(replace(line, properties={"name": name}), frame)
    if candidate is None or candidate.meaning.use == GUIDANCE or candidate.geometry.length > MAX_SHORT_LINE_M:
        return None
    return candidate if shape.covers(candidate.geometry) else None


def _assign_candidate(
    one: _Candidate,
    roles: AssumedRoles,
    shape: shapely.Polygon,
    covered: shapely.Geometry,
    field_names: Sequence[str],
    unknown: list[_Candidate],
) -> bool:
    """Put a feature where it belongs; False if it lies outside the field or is of no use."""
    distance_m = float(shape.distance(one.geometry))
    use = one.meaning.use
    if distance_m > NEAR_FIELD_M:
        return False
    if one.raw.geometry_type == POINT and use in (ENTRANCE, REFILL):
        if use == ENTRANCE and shapely.Polygon(shape.exterior).buffer(-MAX_ENTRANCE_INSIDE_M).covers(one.geometry):
            roles.ignore("far-off entrance", one.label)
            return True
        x, y = shapely.get_coordinates(one.geometry)[0].tolist()
        roles.places[use].append((one.label, (x, y)))
        return True
    is_inside = shape.covers(one.geometry) if one.raw.geometry_type == POINT or not use else distance_m == 0.0
    is_near = is_inside or (use == OBSTACLE and distance_m <= one.size_m)
    if covered.covers(one.geometry):
        roles.ignore("label", one.label)
    elif not is_near:
        return False
    elif one.raw.geometry_type == LINE:
        return _assign_line(one, roles, shape, unknown)
    elif _is_label(one, field_names):
        roles.ignore("label", one.label)
    elif use in (NOTE, GUIDANCE):
        roles.ignore("note" if use == NOTE else "guidance point", one.label)
    elif use == OBSTACLE:
        roles.obstacles.append(one.build_obstacle())
    else:
        unknown.append(one)
    return True


def _assign_line(one: _Candidate, roles: AssumedRoles, shape: shapely.Polygon, unknown: list[_Candidate]) -> bool:
    """A line in or along the field: a fence, another obstacle, an overhead line, or a short line without a name."""
    if one.meaning.use == OVERHEAD_LINE:
        roles.ignore("overhead or buried line", one.label)
    elif one.meaning.use == OBSTACLE:
        side = clip_outline_to_line(shapely.LineString(shape.exterior.coords), one.geometry)
        is_along = one.meaning.kind == FENCE and side.length >= 0.8 * one.geometry.length
        if is_along and side.length > shape.exterior.length - MACHINE_WIDTH_M:
            roles.ignore("closed fence", one.label)
        elif is_along:
            roles.fences.append(replace(one.raw, properties={"edge": FENCE}))
            roles.notes.append(f"Taken as a fence along the boundary by its name: {one.label}.")
        else:
            roles.obstacles.append(one.build_obstacle())
    elif one.geometry.length <= MAX_SHORT_LINE_M:
        unknown.append(one)
    else:
        return False
    return True


def _is_label(one: _Candidate, field_names: Sequence[str]) -> bool:
    """Whether a point only says the name or number of a field; a kind says more than a name."""
    if not is_label(one.name, field_names):
        return False
    return find_meaning({**one.raw.properties, "name": "", "Name": ""}).use != OBSTACLE


def describe_assumed_obstacles(obstacles: Sequence[Obstacle]) -> tuple[str, ...]:
    """A sentence on the obstacles that their file does not call so, each with its number."""
    assumed = [(one.number or place, one) for place, one in enumerate(obstacles, 1) if one.is_assumed]
    if not assumed:
        return ()
    listed = "; ".join(f"({number}) {_describe_obstacle(one)}" for number, one in assumed[:MAX_LISTED])
    remainder = f"; and {len(assumed) - MAX_LISTED} more" if len(assumed) > MAX_LISTED else ""
    is_one = len(assumed) == 1
    subject = "1 feature without a role lies" if is_one else f"{len(assumed)} features without a role lie"
    example = assumed[0][1].name or str(assumed[0][0])
    quoted = example if example.isalnum() else f'"{example}"'
    return (
        f"{subject} in the field and {'is avoided as an obstacle' if is_one else 'are avoided as obstacles'}: {listed}"
        f"{remainder}. To leave one out, give its name or number: --ignore {quoted}.",
    )


def _describe_obstacle(one: Obstacle) -> str:
    kind = f"{one.kind} '{one.name}'" if one.name else one.kind
    if one.geometry.geom_type == POINT:
        return f"{kind}, radius {one.half_width_m:g} m"
    if one.geometry.geom_type == LINE:
        return f"{kind}, {one.geometry.length:.0f} m long and {2.0 * one.half_width_m:g} m wide"
    return f"{kind}, {one.geometry.area:.0f} m2"
