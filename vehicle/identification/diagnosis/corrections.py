"""The logs as they are replayed: copies merged, and what single columns show of their own faults corrected."""

from __future__ import annotations

from collections.abc import Sequence

from vehicle.identification.columns.staleness import mark_stale_columns_of_set
from vehicle.identification.diagnosis.onsets import mark_onset_faults
from vehicle.identification.diagnosis.other_vehicles import drop_course_headings
from vehicle.identification.faults.level_steps import mark_level_step
from vehicle.identification.faults.steering_evidence import correct_heading_jumps
from vehicle.identification.logs.column_quality import (
    drop_columns_coarse_elsewhere,
    drop_commands_not_logged,
    merge_copies,
)
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.sensor_checks import correct_commanded_speeds, correct_sensors_like_others
from vehicle.model.tractor import Tractor


def correct_logs(logs: Sequence[Log], tractor: Tractor) -> list[Log]:
    """Return the logs as they are replayed: each drive once, without coarse columns, courses for headings and rows of
    faults that begin, with sensors and commanded speeds corrected."""
    logs = drop_commands_not_logged(drop_columns_coarse_elsewhere(merge_copies(logs)))
    # Steps of a level go first: wheels that stand elsewhere than they say look as if they did not follow.
    logs = mark_onset_faults(mark_level_step(correct_heading_jumps(drop_course_headings(logs, tractor))))
    return mark_stale_columns_of_set(correct_commanded_speeds(correct_sensors_like_others(logs)))
