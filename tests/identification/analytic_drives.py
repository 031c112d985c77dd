"""Drives in closed form: straight lines and circles as logs and as segments, without noise unless it is asked for."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd

from fields.arrays import Floats
from vehicle.identification.diagnosis.demo_logs import add_instrument_noise, add_soil_noise
from vehicle.identification.diagnosis.next_drive import (
    DRIVE_PROGRAMMES,
    ProgrammePieces,
    build_command_segment,
    simulate_programme,
)
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log
from vehicle.identification.replay.drive_segments import DriveDataset, DriveSegment, ReplayRig, build_dataset, build_rig
from vehicle.identification.replay.simulation import replay_segment
from vehicle.model.tractor import Settings, load_tractor
from vehicle.twin.step_motion import NO_NOISE, TractorNoise

SPEED_MPS = 1.5


def circle(
    curvature_per_m: float, seconds: float = 20.0, rate_hz: float = 10.0, bearing_deg: float = 0.0
) -> pd.DataFrame:
    """A circle driven at SPEED_MPS from (500, 700), positive curvature to the right; 0 is a straight line.

    The steering is 10 degrees per 0.1 of curvature.
    """
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    way = SPEED_MPS * time
    turned = curvature_per_m * way
    middle = math.radians(bearing_deg) + 0.5 * turned
    chord = way * np.sinc(0.5 * turned / math.pi)
    return pd.DataFrame({
        "time_s": time, "easting_m": 500.0 + chord * np.sin(middle), "northing_m": 700.0 + chord * np.cos(middle),
        "heading_deg": np.mod(bearing_deg + np.degrees(turned), 360.0), "speed_mps": SPEED_MPS,
        "steering_deg": 100.0 * curvature_per_m,
    })  # fmt: skip


def backwards(frame: pd.DataFrame) -> pd.DataFrame:
    """The drive in reverse gear from its end to its start: the same places and headings, the other way round."""
    return frame.iloc[::-1].reset_index(drop=True).assign(time_s=frame.time_s, shuttle=-1)


def log(frame: pd.DataFrame, name: str = "run", **columns: object) -> Log:
    """The frame as a log, conventions unchecked, some columns replaced."""
    return build_log(frame.assign(**columns), name, check=False)


def joined(*frames: pd.DataFrame) -> pd.DataFrame:
    """Drives one after another: each starts where and when the one before ends."""
    out = [frames[0]]
    for frame in frames[1:]:
        last, step = out[-1].iloc[-1], frame.time_s[1] - frame.time_s[0]
        moved = frame.assign(
            time_s=frame.time_s + last.time_s + step,
            easting_m=frame.easting_m - frame.easting_m[0] + last.easting_m,
            northing_m=frame.northing_m - frame.northing_m[0] + last.northing_m,
        )
        out.append(moved)
    return pd.concat(out, ignore_index=True)


def rig() -> ReplayRig:
    """The EG105 on soil."""
    return build_rig(load_tractor("eg105"), "soil", (0.0, 0.0))


def course(*frames: pd.DataFrame) -> DriveDataset:
    """Segments of frames."""
    return build_dataset([log(frame, f"run {number}") for number, frame in enumerate(frames)])


def measured(
    pieces: ProgrammePieces, noise: TractorNoise = NO_NOISE, seed: int = 1, rate_hz: float = 10.0, run: int = 0
) -> DriveSegment:
    """What the tractor of `rig` would log of a drive over ground and with instruments of this noise.

    Wheel angle and speed are logged without noise; pieces as in diagnosis.next_drive, at SPEED_MPS.
    """
    rng, tractor = np.random.default_rng(seed), rig()
    drive = build_command_segment(run, 0.0, pieces, SPEED_MPS, 1.0 / rate_hz)
    states = add_soil_noise(noise, replay_segment(tractor, drive, {}, from_sensor=False, from_speed=False), rng)
    shown, wheel, speed = add_instrument_noise(tractor, noise, drive, states, {}, rng)
    return logged(shown, wheel, speed)


def logged(shown: DriveSegment, wheel: Floats, speed: Floats) -> DriveSegment:
    """A segment with wheel angle and speed (k,), and the grids that a log of it would have."""
    grid = np.arange(len(shown.grids["east"])) / 60.0
    columns = {"east": shown.east, "north": shown.north, "heading": shown.heading, "wheel": wheel, "speed": speed}
    grids = shown.grids | {name: np.interp(grid, shown.time, values) for name, values in columns.items()}
    return replace(shown, wheel=wheel, speed=speed, grids=grids)


def simulated(programme: str, settings: Settings) -> DriveDataset:
    """What the tractor of `rig` would log with these effects on a programme, without noise."""
    made = next(one for one in DRIVE_PROGRAMMES if one.id == programme)
    return simulate_programme(rig(), made, 0.0, 1.4, settings)
