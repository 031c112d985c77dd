"""Moves driven between the lines that they join: once for all that are alike, many in one simulation.

On ground that is the same everywhere a move is driven from the origin, so that what it takes depends on nothing but its
shape and that of the lines; elsewhere it is driven in its place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import shapely

from fields.arrays import SHORTEST_PIECE_M, Flags, Floats, build_directions, measure_along
from fields.geometry.arithmetic import multiply
from strategies.lines.lay_lines import measure_proof_rooms
from strategies.lines.work_line import MOST_OFF_SHARE, extend_line
from strategies.moves.move import Move
from strategies.path_planning.paths import PATH_KINDS, DrivePath, Pose
from strategies.rules.legs import MIN_STEP_M, PATH_STEP_M
from strategies.site.site import MISSED_FACTOR, SETTLE_M, SETTLED_M, STRAIGHT_M, Site
from vehicle.missions.plan import SWATH, TURN, Leg, LegTask, Mission, Plan
from vehicle.missions.run import SimulationRun

ROOM_TOLERANCE_M = 0.03
MOST_AT_ONCE = 16  # moves in one simulation, of about the same length
LEADS_M = (0.0, 1.25, 2.5, 5.0, 10.0, 20.0)  # driven straight after a quarter of a circle
START: Pose = (0.0, 0.0, 0.0)

Alike = tuple[Pose, bytes, bool, int, bytes, bytes]


@dataclass(frozen=True, eq=False)
class Passage:
    """A move with the stretches (n, 2) of lines before and after it; None where it begins or ends at rest.

    `at_gate` is whether it is part of a way in or out.
    """

    move: Move
    before: Floats | None
    after: Floats | None
    at_gate: bool = False


@dataclass(frozen=True, eq=False)
class MoveDrive:
    """How a passage is driven.

    Attributes:
        drive_s: seconds that the move takes, with what the lines before and after it lose to it.
        off_m: how far beside the line that follows it is begun.
        missed_m2: ground that is missed until the tractor has settled on it.
        poses: (t, 3) of the centre of mass, as seen from where the move begins.
        is_folded: (t,) whether the implement is folded there.
    """

    drive_s: float
    off_m: float
    missed_m2: float
    poses: Floats
    is_folded: Flags


@dataclass(eq=False)
class MoveDrives:
    """Drives moves of a site, and remembers what is alike; with `is_level` as if its ground were level everywhere."""

    site: Site
    is_level: bool
    _drives: dict[Alike, MoveDrive | None] = field(default_factory=dict)

    def prove(self, passages: Sequence[Passage]) -> list[Move | None]:
        """Moves with their time as driven; None where it is not driven, leaves the ground or loses its line.

        Ground missed because a line is begun beside it is charged.
        """
        drives = self.drive(passages)
        return [self._judge(each, drive) for each, drive in zip(passages, drives, strict=True)]

    def measure_start_s(self, distance_m: float) -> float:
        """Seconds from rest to so far along a straight line (at most SETTLE_M)."""
        time_s, driven_m = self._straight
        return float(np.interp(distance_m, driven_m, time_s))

    @property
    def pace_share(self) -> float:
        """The mean speed from rest to rest on STRAIGHT_M, as a share of the working speed."""
        time_s, driven_m = self._straight
        return float(driven_m[-1] / time_s[-1]) / self.site.rules.work_speed_mps

    @property
    def rest_s(self) -> float:
        """Seconds that a straight line takes longer from rest to rest than at working speed."""
        time_s, _ = self._straight
        return float(time_s[-1]) - STRAIGHT_M / self.site.rules.work_speed_mps

    @cached_property
    def _straight(self) -> tuple[Floats, Floats]:
        """Times and metres of `Site.straight_run`."""
        run = self.site.straight_run
        return run.time_s, measure_along(run.get_poses(0)[:, :2])

    def drive(self, passages: Sequence[Passage]) -> list[MoveDrive | None]:
        """How passages are driven; None if they are not. Only what nothing alike was driven of yet is driven."""
        keys = [self._describe(each) for each in passages]
        todo = {key: each for key, each in zip(keys, passages, strict=True) if key not in self._drives}
        by_length = sorted(todo.items(), key=lambda item: item[1].move.path.length_m)
        for first in range(0, len(todo), MOST_AT_ONCE):
            self._drive_together(by_length[first : first + MOST_AT_ONCE])
        return [self._drives[key] for key in keys]

    def _describe(self, passage: Passage) -> Alike:
        """What a drive depends on: on ground that is the same everywhere only the shapes."""
        move, path, lines = passage.move, passage.move.path, list[bytes]()
        for pose, points in ((path.start, passage.before), (path.end, passage.after)):
            seen = np.empty((0, 2)) if points is None else _see_from(pose, points)
            lines.append((np.round(seen, 2) + 0.0).tobytes())  # to a centimetre
        start = START if self.is_level else move.start
        return start, move.rows.tobytes(), move.is_work, move.is_folded + move.begins_folded, lines[0], lines[1]

    def _drive_together(self, todo: Sequence[tuple[Alike, Passage]]) -> None:
        """Drive some moves at once, each as if it were alone; the others again where one got stuck."""
        remaining = [(key, self._build_legs(key, passage.move)) for key, passage in todo]
        while remaining:
            drive = self.site.drive_level if self.is_level else self.site.drive
            run = drive(Plan(tuple(Mission(tuple(legs)) for _, legs in remaining)))
            is_done = np.isfinite(run.finish_s)
            for number in np.flatnonzero(is_done).tolist():
                key, legs = remaining[number]
                self._drives[key] = self._measure(run, number, legs, key)
            failed = None if run.stall is None else run.stall.tractor
            undone = [number for number, done in enumerate(is_done) if not done]
            for number in undone if failed is None else [failed]:
                self._drives[remaining[number][0]] = None
            remaining = [remaining[number] for number in undone if failed not in (None, number)]

    def _build_legs(self, key: Alike, move: Move) -> list[Leg]:
        """The legs of a move with the lines that are driven with it, in its place or at the origin."""
        path = replace(move.path, start=key[0])
        before, after = (np.frombuffer(seen).reshape(-1, 2) for seen in key[4:])
        legs = build_move_legs(self.site, replace(move, start=path.start), LegTask(SWATH if move.is_work else TURN))
        if len(before):
            legs.insert(0, build_work_leg(self.site, _place_at(path.start, before), LegTask(SWATH)))
        if len(after):
            line = build_work_leg(self.site, _place_at(path.end, after), LegTask(SWATH))
            legs.append(line.copy_with(fold_s=self.site.get_fold_s(move.is_folded)))
        return legs

    def _measure(self, run: SimulationRun, number: int, legs: Sequence[Leg], key: Alike) -> MoveDrive:
        """The drive of one of several tractors that pass each other by."""
        frame, _, _, _, before, after = key
        rows = 1 + int(np.searchsorted(run.time_s, run.finish_s[number]))
        time_s, poses = run.time_s[:rows], run.get_poses(number)[:rows]
        begun_s = self.measure_start_s(legs[0].length_m) if before else 0.0
        seen = np.column_stack([_see_from(frame, poses[:, :2]), poses[:, 2] - frame[2]])
        is_folded = run.find_folded_rows(number)[:rows]
        if not after:
            return MoveDrive(float(run.finish_s[number]) - begun_s, 0.0, 0.0, seen, is_folded)
        line = legs[-1]
        row = int(np.argmax(run.get_leg_numbers(number) == len(legs) - 1))
        settled_m = min(SETTLE_M, 0.5 * line.length_m)
        driven_m = measure_along(poses[row:, :2])
        end_s = float(np.interp(settled_m, driven_m, time_s[row:]))
        drive_s = end_s - begun_s - settled_m / self.site.rules.work_speed_mps
        off_m = self._measure_off_m(line.points, poses[row:][driven_m <= settled_m])
        return MoveDrive(
            drive_s, float(off_m[0]), multiply(off_m[:-1], np.diff(driven_m[: len(off_m)])), seen, is_folded
        )

    def _measure_off_m(self, line: Floats, poses: Floats) -> Floats:
        """How far (t,) beside a line (n, 2) the implement is, with the centre of mass at poses (t, 3)."""
        back = self.site.bar_m * build_directions(poses[:, 2])
        long = shapely.LineString(extend_line(line, SETTLE_M, SETTLE_M))
        off_m: Floats = shapely.distance(long, shapely.points(poses[:, :2] - back))
        return off_m

    def _judge(self, passage: Passage, drive: MoveDrive | None) -> Move | None:
        """A move as driven, if it keeps to the ground of its place and finds its line."""
        move, site = passage.move, self.site.at_gate if passage.at_gate else self.site
        if drive is None or drive.off_m > MOST_OFF_SHARE * self.site.width_m:
            return None
        places = _place_at(move.start, drive.poses[:, :2])
        poses = np.column_stack([places, drive.poses[:, 2] + move.start[2]])
        if measure_proof_rooms(site, poses, drive.is_folded).min() < -ROOM_TOLERANCE_M:
            return None
        cut_s = (move.leave_m + move.join_m) / self.site.rules.work_speed_mps
        return replace(move, drive_s=drive.drive_s - cut_s, settling_s=compute_missed_s(self.site, drive.missed_m2))


def measure_settling(site: Site) -> Floats:
    """Metres driven straight after an arc, and the charge in seconds for beginning a line then (2, k)."""
    radius_m, before = site.rules.radius_m, np.array([[-SETTLE_M, 0.0], [0.0, 0.0]])
    passages = []
    for lead_m in LEADS_M:
        rows = np.array([[0.5 * math.pi * radius_m, 1.0 / radius_m, 1.0], [lead_m, 0.0, 1.0]])
        after = np.array([[radius_m, radius_m + lead_m], [radius_m, radius_m + lead_m + SETTLED_M]])
        passages.append(Passage(Move(START, rows, PATH_KINDS[0], 0.0), before, after))
    missed_m2 = [drive.missed_m2 if drive else 0.0 for drive in MoveDrives(site, is_level=True).drive(passages)]
    return np.array([LEADS_M, [compute_missed_s(site, each) for each in missed_m2]])


def compute_missed_s(site: Site, missed_m2: float) -> float:
    """Seconds that ground is worth which is missed."""
    return MISSED_FACTOR * missed_m2 * site.work_s_per_m2


def _see_from(pose: Pose, points: Floats) -> Floats:
    """Points (n, 2) as seen from a pose."""
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    seen: Floats = multiply(points - pose[:2], [[cosine, -sine], [sine, cosine]])
    return seen


def _place_at(pose: Pose, points: Floats) -> Floats:
    """Points (n, 2) seen from a pose as they lie."""
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    places: Floats = multiply(points, [[cosine, sine], [-sine, cosine]]) + pose[:2]
    return places


def build_work_leg(site: Site, points: Floats, task: LegTask) -> Leg:
    """A leg along points (n, 2) that works."""
    x, y = points[len(points) // 2].tolist()
    return Leg(points, site.rules.work_speed_mps, 1, True, site.layout.field.find_ground_at(x, y), task)


def build_move_legs(site: Site, move: Move, task: LegTask) -> list[Leg]:
    """The legs of a move; the tractor stands before the first to fold its implement where the move needs that."""
    legs = build_path_legs(site, move.path, task, is_work=move.is_work)
    if not move.is_folded:
        return legs
    first_s = site.get_fold_s(not move.begins_folded)
    return [leg.copy_with(folded=True, fold_s=0.0 if number else first_s) for number, leg in enumerate(legs)]


def build_path_legs(site: Site, path: DrivePath, task: LegTask, *, is_work: bool = False) -> list[Leg]:
    """A path as legs, one per gear; with the implement down where it is work."""
    legs = []
    for gear, sampled in path.sample(PATH_STEP_M):
        steps_m = np.hypot(*np.diff(sampled, axis=0).T)
        points = sampled[np.concatenate([[True], steps_m > MIN_STEP_M])]
        if float(steps_m.sum()) <= SHORTEST_PIECE_M:
            continue
        x, y = points[len(points) // 2].tolist()
        speed_mps = site.rules.work_speed_mps if is_work else site.rules.get_path_speed_mps(gear)
        ground = site.layout.field.find_ground_at(x, y)
        legs.append(Leg(points, speed_mps, gear, is_work, ground, task))
    return legs
