"""Drives that could be made: programmes that a person can follow, and what a tractor would log on them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveDataset, DriveSegment
from vehicle.identification.replay.rig import ReplayRig
from vehicle.identification.replay.simulation import replay_segment, simulate_logged_values
from vehicle.model.tractor import Settings
from vehicle.records import DT_S

PROGRAMME_STEP_S = 0.1  # rows of a simulated log: the usual 10 Hz
PROGRAMME_PACE_MPS = 1.4  # 5 km/h, the speed of the thesis's experiments
ProgrammePiece = tuple[float, float, float, float]
ProgrammePieces = tuple[ProgrammePiece, ...]


@dataclass(frozen=True)
class DriveProgramme:
    """A drive for a person to make: passes, each with a first heading (deg to the right of the usual one) and pieces.

    A piece is (seconds, wheel angle in deg, share of the usual speed, implement 0 or 1).
    """

    id: str
    description: str
    passes: tuple[tuple[float, ProgrammePieces], ...]

    @property
    def seconds(self) -> float:
        """Duration of the drive."""
        return sum(piece[0] for _, pieces in self.passes for piece in pieces)


def _build_programme(id: str, description: str, *passes: tuple[float, ProgrammePieces]) -> DriveProgramme:
    return DriveProgramme(id, description, passes)


DRIVE_PROGRAMMES: tuple[DriveProgramme, ...] = (
    _build_programme(
        "implement-lifted",
        "Drive straight ahead for 30 s, implement up for the first 15 s, then down.",
        (0.0, ((15.0, 0.0, 1.0, 0.0), (15.0, 0.0, 1.0, 1.0))),
    ),
    _build_programme(
        "there-and-back",
        "Drive the same straight line there and back, 20 s each way, with the implement unchanged.",
        (0.0, ((20.0, 0.0, 1.0, 1.0),)),
        (180.0, ((20.0, 0.0, 1.0, 1.0),)),
    ),
    _build_programme(
        "there-and-back-lifted",
        "Drive the same straight line there and back, 20 s each way, implement up.",
        (0.0, ((20.0, 0.0, 1.0, 0.0),)),
        (180.0, ((20.0, 0.0, 1.0, 0.0),)),
    ),
    _build_programme(
        "circles",
        "Drive a circle to the right and one to the left at 15 degrees, 20 s each.",
        (0.0, ((20.0, 15.0, 1.0, 0.0),)),
        (0.0, ((20.0, -15.0, 1.0, 0.0),)),
    ),
    _build_programme(
        "two-speeds",
        "Drive a circle at 12 degrees for 20 s slowly and for 15 s at twice the speed.",
        (0.0, ((20.0, 12.0, 0.7, 0.0), (15.0, 12.0, 2.0, 0.0))),
    ),
    _build_programme(
        "steps",
        "Steer in steps of 4, 8 and 15 degrees to both sides, 4 s each.",
        (0.0, tuple((4.0, a, 1.0, 0.0) for a in (0.0, 4.0, -4.0, 8.0, -8.0, 15.0, -15.0, 0.0))),
    ),
    _build_programme(
        "small-steps",
        "Steer in steps of half a degree up to 2 degrees and back, 4 s each.",
        (0.0, tuple((4.0, a, 1.0, 0.0) for a in (0.0, 0.5, 0.0, -1.0, 0.5, 2.0, 0.0, -2.0, 0.0))),
    ),
    _build_programme(
        "bends-at-speeds",
        "Weave at 10 degrees, 6 s each way, at three speeds.",
        (0.0, tuple((6.0, a, s, 0.0) for s in (0.6, 1.2, 2.0) for a in (10.0, -10.0))),
    ),
    _build_programme(
        "shuffled-bends",
        "Steer to 20, 5, 25, 10, 15 and 5 degrees, 5 s to the right and 5 s to the left each, in this order.",
        (0.0, tuple((5.0, side * a, 1.0, 0.0) for a in (20.0, 5.0, 25.0, 10.0, 15.0, 5.0) for side in (1.0, -1.0))),
    ),
    _build_programme(
        "four-ways",
        "Drive straight ahead to all four points of the compass, 15 s each, implement up.",
        *[(float(way), ((15.0, 0.0, 1.0, 0.0),)) for way in (0, 90, 180, 270)],
    ),
)


def simulate_programme(
    rig: ReplayRig,
    programme: DriveProgramme,
    heading: float,
    pace: float,
    settings: Settings,
    step: float = PROGRAMME_STEP_S,
) -> DriveDataset:
    """Return the log of the tractor with these effects on each pass of a programme, without noise.

    `heading` (rad) and `pace` (m/s) are the usual ones; the log has a row every `step` seconds.
    """
    segments = [
        _simulate_instrument_readings(
            rig, build_command_segment(run, heading - math.radians(turn), pieces, pace, step), settings
        )
        for run, (turn, pieces) in enumerate(programme.passes)
    ]
    names = tuple(f"pass {run + 1}" for run in range(len(segments)))
    return DriveDataset(names, tuple(segments), (0.0, 0.0), sum(segment.rows for segment in segments))


def _simulate_instrument_readings(rig: ReplayRig, blank_segment: DriveSegment, settings: Settings) -> DriveSegment:
    """Return a blank drive with the readings of the instruments."""
    states = replay_segment(rig, blank_segment, settings, from_sensor=False, from_speed=True)
    antenna, angle, wheel, speed = (
        np.ascontiguousarray(part) for part in simulate_logged_values(rig, blank_segment, states, settings)
    )
    grid = np.arange(len(states)) * DT_S
    grids = dict(blank_segment.grids)
    for name, values in (("east", antenna[:, 0]), ("north", antenna[:, 1]), ("heading", angle), ("wheel", wheel)):
        grids[name] = np.interp(grid, blank_segment.time, values)
    return replace(
        blank_segment, east=antenna[:, 0], north=antenna[:, 1], heading=angle, wheel=wheel, speed=speed, grids=grids
    )


def find_usual_heading_and_speed(segments: Sequence[DriveSegment]) -> tuple[float, float]:
    """Return the most frequent heading (rad; the first one's if the drive repeats) and the median speed (m/s) of a
    dataset."""
    east = np.concatenate([np.cos(segment.heading) for segment in segments])
    north = np.concatenate([np.sin(segment.heading) for segment in segments])
    pace = float(np.median(np.concatenate([segment.speed_in_gear for segment in segments]))) or PROGRAMME_PACE_MPS
    return math.atan2(float(north.mean()), float(east.mean())), pace


def build_command_segment(
    run: int, heading: float, pieces: ProgrammePieces, pace: float, step: float = PROGRAMME_STEP_S
) -> DriveSegment:
    """Return a drive that has only its commands yet: pieces as in DriveProgramme, `heading` in rad, a row every `step`
    seconds."""
    ends = np.cumsum([piece[0] for piece in pieces])
    time = np.arange(0.0, ends[-1] - 1e-9, step)
    grid = np.arange(math.ceil(time[-1] / DT_S) + 1) * DT_S

    def select_values(times: npt.NDArray[Any], column: int, factor: float) -> Array:
        values = np.array([piece[column] for piece in pieces]) * factor
        return values[np.minimum(np.searchsorted(ends, times, side="right"), len(pieces) - 1)]

    columns = {"command": (1, math.pi / 180.0), "target": (2, pace), "working": (3, 1.0), "speed": (2, pace)}
    grids = {name: select_values(grid, *column_spec) for name, column_spec in columns.items()}
    grids |= {"east": np.zeros(len(grid)), "north": np.zeros(len(grid)), "heading": np.full(len(grid), heading)}
    rows = {name: select_values(time, *column_spec) for name, column_spec in columns.items()}
    zero = np.zeros(len(time))
    return DriveSegment(
        run,
        0.0,
        time,
        zero,
        zero,
        np.full(len(time), heading),
        True,
        rows["speed"],
        True,
        None,
        rows["command"],
        rows["target"],
        rows["working"],
        grids,
    )
