"""Instruments that are late, smoothed, on another clock or of another scale, in a replay.

Lateness of positions and headings is added to what a replay shows. Speeds, wheel angles and commands are inputs of a
replay as well: there their clocks and scale are taken out first.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.model.effects import STEP_HZ, compute_effect_fields
from vehicle.model.instruments import compute_filter_share
from vehicle.model.tractor import Settings
from vehicle.records import DT_S


@dataclass(frozen=True)
class InstrumentTiming:
    """How old the columns of a log are (s), the time constant of the heading (s), and the scale of the speed."""

    position_s: float = 0.0
    heading_s: float = 0.0
    heading_filter_s: float = 0.0
    speed_s: float = 0.0
    speed_scale: float = 1.0
    steering_s: float = 0.0
    command_s: float = 0.0

    @property
    def is_heading_as_old(self) -> bool:
        """Whether headings are as old as positions, and not smoothed."""
        return self.heading_s == self.position_s and self.heading_filter_s == 0.0

    @property
    def has_neutral_inputs(self) -> bool:
        """Whether speed, wheel angle and command are as they were when they were logged."""
        return self.speed_s == self.steering_s == self.command_s == 0.0 and self.speed_scale == 1.0


def compute_timing(settings: Settings) -> InstrumentTiming:
    """Return the timing of the instruments with these effects."""
    return extract_timing(compute_effect_fields(settings))


def extract_timing(fields: Mapping[str, float]) -> InstrumentTiming:
    """Return the timing of the instruments from the fields of MODEL."""
    return InstrumentTiming(
        (fields["latency"] + fields["position_late"]) / STEP_HZ + fields["position_clock"],
        (fields["latency"] + fields["heading_late"]) / STEP_HZ + fields["heading_clock"],
        fields["heading_filter"],
        fields["speed_clock"],
        fields["speed_scale"],
        fields["steering_clock"],
        fields["command_clock"],
    )


def restore_true_inputs(segment: DriveSegment, timing: InstrumentTiming) -> DriveSegment:
    """Return a segment whose speed, wheel angle and command on the grid are as they were at its times.

    A replay at commanded speeds begins with the first speed that was logged, whatever its clock.
    """
    if timing.has_neutral_inputs:
        return segment
    grids, steps_s, earlier = dict(segment.grids), segment.steps_s, segment.earlier_commands
    if timing.command_s != 0.0 and "command" in grids:
        earlier = _shift_earlier_commands(segment, timing.command_s)
    for name, late_s in (("speed", timing.speed_s), ("wheel", timing.steering_s), ("command", timing.command_s)):
        if name in grids and late_s != 0.0:
            first = grids[name][0]
            grids[name] = np.interp(steps_s + late_s, steps_s, grids[name])
            grids[name][0] = first if name == "speed" else grids[name][0]
    if timing.speed_scale != 1.0:
        grids["speed"] = grids["speed"] / timing.speed_scale
    logged_wheel = segment.logged_wheel
    if timing.steering_s != 0.0 and segment.wheel is not None:
        time, wheel = logged_wheel or (segment.time, segment.wheel)
        logged_wheel = (time - timing.steering_s, wheel)
    return replace(segment, grids=grids, logged_wheel=logged_wheel, earlier_commands=earlier)


def _shift_earlier_commands(segment: DriveSegment, late_s: float) -> Array:
    """Return the commands (m,) before the first row as they were at their times, where their clock is late."""
    known = np.concatenate([segment.earlier_commands, segment.grids["command"]])
    steps_s = DT_S * (np.arange(len(known)) - len(segment.earlier_commands))
    shifted: Array = np.interp(steps_s + late_s, steps_s, known)
    return shifted[: len(segment.earlier_commands)]


def compute_shown_headings(segment: DriveSegment, angles: Array, timing: InstrumentTiming) -> Array:
    """Return what a compass without bias shows (rad) in the rows of a segment, from true angles (n,) on its grid."""
    if timing.heading_filter_s > 0.0:
        share = compute_filter_share(timing.heading_filter_s)
        angles = lfilter([share], [1.0, share - 1.0], angles, zi=[(1.0 - share) * angles[0]])[0]
    shown: Array = np.interp(segment.time - timing.heading_s, segment.steps_s, angles)
    return shown


def simulate_logged_wheel_angles(segment: DriveSegment, angles: Array, timing: InstrumentTiming) -> Array:
    """Return what the wheel sensor would log (k,) of angles (n,) on the grid."""
    logged: Array = np.interp(segment.time - timing.steering_s, np.arange(len(angles), dtype=np.float64) * DT_S, angles)
    return logged


def simulate_logged_speeds(segment: DriveSegment, speeds: Array, timing: InstrumentTiming) -> Array:
    """Return what the speed sensor would log (k,) of speeds (n,) on the grid."""
    logged: Array = np.interp(segment.time - timing.speed_s, np.arange(len(speeds), dtype=np.float64) * DT_S, speeds)
    return logged if timing.speed_scale == 1.0 else timing.speed_scale * logged
