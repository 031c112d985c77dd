"""Who takes over which of the tracks that are left: whoever would be done with it soonest, one piece after another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import shapely
import shapely.ops

from planner.service.centre.course import Course
from strategies.headland.laps import link
from strategies.job import Job, Pass
from strategies.legs import driven_legs, pass_legs, with_stops
from strategies.ways.paths import Path, Pose
from strategies.ways.search import shortest_m
from vehicle.missions import DRIVE_IN, ROUND, TRACK, TURN, WAY, Leg, Task

SHORTEST_M = 2.0  # what is left of a track and shorter is not worth a way
OVERLAP_M = 1.0
LONG_TURN_M, STOPS_M = 40.0, 12.0
Points = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Piece:
    """Work that is left: the ways in which it can be driven, each a run of legs."""

    ways: tuple[tuple[Leg, ...], ...]
    work_m: float


@dataclass
class Hand:
    """A tractor that takes over: when it is free, where, and the legs it got."""

    number: int
    free_s: float
    pose: Pose
    legs: list[Leg]


def pieces_left(
    course: Course, first: int, first_m: float, job: Job, blocked: shapely.Geometry
) -> tuple[list[Piece], float]:
    """What is worked after `first_m` metres of leg `first`: whole tracks either way, others from where they are left.

    What lies in `blocked` is left out; its metres are the second value.
    """
    pieces: list[Piece] = []
    blocked_m = 0.0
    legs, k = course.legs, first
    while k < len(legs):
        if legs[k].task.kind not in (TRACK, ROUND, DRIVE_IN):
            k += 1
            continue
        run = [legs[k]]
        while k + len(run) < len(legs) and _goes_on(run[-1], legs[k + len(run)]):
            run.append(legs[k + len(run)])
        begun = k == first and (first_m > 0.0 or (k > 0 and _goes_on(legs[k - 1], run[0])))
        whole = None if begun else _whole(run[0], job, blocked)
        if whole is None:
            parts, lost_m = _parts(run, first_m if begun else 0.0, blocked)
            blocked_m += lost_m
        pieces += [whole] if whole else parts
        k += len(run)
    return pieces, blocked_m


def _goes_on(before: Leg, leg: Leg) -> bool:
    """Whether a leg works on at the same track or side, straight on."""
    return leg.task.kind in (TRACK, DRIVE_IN) and before.task.kind != ROUND and before.task.same_goal(leg.task)


def _whole(first: Leg, job: Job, blocked: shapely.Geometry) -> Piece | None:
    """A track that nobody has begun and nothing stands on."""
    if first.task.kind == ROUND:
        return None
    track = next((t for t in job.layout.tracks if (t.line, t.piece) == (first.task.number, first.task.piece)), None)
    if track is None:
        return None
    ways = tuple(tuple(pass_legs(job, Pass(track, direction))) for direction in (1, -1))
    if any(shapely.intersects(shapely.LineString(leg.points), blocked) for way in ways for leg in way):
        return None
    return Piece(ways, track.length)


def _parts(run: Sequence[Leg], driven_m: float, blocked: shapely.Geometry) -> tuple[list[Piece], float]:
    """Runs of legs without what was driven and what lies in `blocked`, in the direction they have; and its metres."""
    points = np.concatenate([leg.points for leg in run])
    line = shapely.remove_repeated_points(shapely.LineString(points), 1e-6)
    line = shapely.ops.substring(line, max(driven_m - OVERLAP_M, 0.0), line.length)
    works = next((leg for leg in run if leg.implement), run[0])
    pieces = []
    for part in shapely.get_parts(shapely.difference(line, blocked)).tolist():
        if part.geom_type == "LineString" and part.length >= SHORTEST_M:
            leg = replace(works, points=np.asarray(part.coords), gates=(), follow=None, stand_s=0.0, may_wait=True)
            pieces.append(Piece(((leg,),), part.length))
    return pieces, float(shapely.intersection(line, blocked).length)


def pose_at(leg: Leg, end: int) -> Pose:
    """Pose of the tractor at one end of a leg, 0 or -1."""
    (x0, y0), (x1, y1) = leg.points[:2] if end == 0 else leg.points[-2:]
    x, y = leg.points[end]
    return float(x), float(y), math.atan2(leg.gear * (y1 - y0), leg.gear * (x1 - x0))


def hand_over(pieces: Sequence[Piece], hands: Sequence[Hand], job: Job) -> list[Piece]:
    """Give every piece to a hand; those that nobody can reach are returned.

    A piece whose end leads nowhere is taken as a last resort only: whoever took it would be of no more use.
    """
    left = list(pieces)
    for leads_on in (True, False):
        while left and _handed(left, hands, job, leads_on):
            pass
    return left


def _handed(left: list[Piece], hands: Sequence[Hand], job: Job, leads_on: bool) -> bool:
    """Give away the piece that is done soonest, and take it out of `left`; False where nobody can take any."""
    offers = sorted(
        (hand.free_s + _way_s(job, hand.pose, way) + _work_s(way), hand.number, place, direction)
        for hand in hands for place, piece in enumerate(left) for direction, way in enumerate(piece.ways)
    )  # fmt: skip
    for _, number, place, direction in offers:
        hand = next(each for each in hands if each.number == number)
        way, others = left[place].ways[direction], [*left[:place], *left[place + 1 :]]
        if leads_on != _leads_on(job, pose_at(way[-1], -1), others):
            continue
        if _taken(job, hand, way):
            del left[place]
            return True
    return False


def _leads_on(job: Job, pose: Pose, others: Sequence[Piece]) -> bool:
    """Whether a way leads on from a pose: out of the field, or to one of the other pieces where it has no gate."""
    if job.gate is not None:
        return way_between(job, pose, job.gate.out().start) is not None
    return not others or any(way_between(job, pose, pose_at(way[0], 0)) for one in others for way in one.ways)


def way_between(job: Job, a: Pose, b: Pose) -> Path | None:
    """The way between two pieces of work: any there is, also from the corners, where sides end at the edge."""
    return job.way(a, b) or link(job, a, b, anyhow=True)


def _taken(job: Job, hand: Hand, way: tuple[Leg, ...]) -> bool:
    path = way_between(job, hand.pose, pose_at(way[0], 0))
    if path is None:
        return False
    there = to_work(job, path, way[0].task)
    hand.legs += [*there, *way]
    hand.free_s += sum(leg.length_m / leg.speed_mps for leg in (*there, *way))
    hand.pose = pose_at(way[-1], -1)
    return True


def to_work(job: Job, path: Path, task: Task) -> list[Leg]:
    """The legs of a way to some work."""
    kind = WAY if path.kind == "route" or path.length_m > LONG_TURN_M else TURN
    return with_stops(driven_legs(job, path, replace(task, kind=kind)), STOPS_M)


def _way_s(job: Job, pose: Pose, way: tuple[Leg, ...]) -> float:
    metres = shortest_m(np.array(pose), np.array(pose_at(way[0], 0)), job.manner.radius_m)
    return float(metres) / job.manner.turn_speed_mps


def _work_s(way: tuple[Leg, ...]) -> float:
    return sum(leg.length_m / leg.speed_mps for leg in way)
