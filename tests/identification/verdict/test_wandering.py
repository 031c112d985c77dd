"""Positions that wander while headings turn as the wheels say are told so; what turns the tractor is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.identification.analytic_drives import course_of, measured, rig
from vehicle.identification.cause_selection.covariates import list_covariates
from vehicle.identification.fit.residual_fit import make_empty_fit
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.identification.residuals.innovations import NoiseLevels
from vehicle.identification.residuals.residual_model import ResidualModel, build_residual_model
from vehicle.identification.verdict.wandering import HeadingWitness, describe_wander

NOISE = NoiseLevels(0.01, 0.0, 0.003, 0.0, 0.0005, 0.0)
PIECES = tuple((12.0, angle_deg, 1.0, 0.0) for angle_deg in (0.0, 12.0, -8.0, 0.0, -12.0, 6.0))
PERIOD_S = 7.0


def drive() -> list[DriveSegment]:
    return [measured(PIECES, NOISE, seed=run + 1, run=run) for run in range(3)]


def sway(segment: DriveSegment, size_m: float) -> DriveSegment:
    """Positions that swing to the left and right of the path, and nothing else."""
    aside = size_m * np.sin(2.0 * np.pi * segment.time / PERIOD_S)
    east = segment.east - aside * np.sin(segment.heading)
    return replace(segment, east=east, north=segment.north + aside * np.cos(segment.heading))


def bend(segment: DriveSegment, size_rad_per_m: float) -> DriveSegment:
    """Positions and headings of a tractor that swings to the left and right."""
    step_s = np.diff(segment.time)
    rate = size_rad_per_m * np.sin(2.0 * np.pi * segment.time[:-1] / PERIOD_S) * segment.speed[:-1]
    turned = np.concatenate([[0.0], np.cumsum(rate * step_s)])
    moved = np.diff(segment.east) + 1j * np.diff(segment.north)
    path = np.concatenate([[0.0], np.cumsum(moved * np.exp(1j * turned[:-1]))])
    east, north = segment.east[0] + path.real, segment.north[0] + path.imag
    return replace(segment, east=east, north=north, heading=segment.heading + turned)


def build_model(segments: list[DriveSegment]) -> ResidualModel:
    return build_residual_model(course_of(*segments), rig(), {})


def build_witness(segments: list[DriveSegment]) -> HeadingWitness:
    model = build_model(segments)
    return HeadingWitness(model, make_empty_fit(model), {})


def test_positions_that_sway_wander_by_as_much() -> None:
    wander_m = build_witness([sway(one, 0.08) for one in drive()]).wander_m
    assert wander_m is not None and wander_m == pytest.approx(0.08, abs=0.03)
    assert "wander by up to 8 cm" in describe_wander(0.08).words and describe_wander(0.08).instrument == "position"


def test_noise_is_no_wander_and_a_tractor_that_swings_is_none_either() -> None:
    assert build_witness(drive()).wander_m is None
    assert build_witness([bend(one, 0.03) for one in drive()]).wander_m is None


def test_an_antenna_elsewhere_and_a_heading_bias_are_no_wander() -> None:
    shifted = [
        replace(one, east=one.east + 0.3 * np.cos(one.heading), north=one.north + 0.3 * np.sin(one.heading))
        for one in drive()
    ]
    assert build_witness(shifted).wander_m is None
    assert build_witness([replace(one, heading=one.heading + 0.03) for one in drive()]).wander_m is None


def test_without_a_measured_heading_nothing_is_said() -> None:
    segments = [replace(sway(one, 0.08), heading_measured=False) for one in drive()]
    assert build_witness(segments).wander_m is None


def test_headings_contradict_a_wave_of_positions_alone_and_show_that_of_a_tractor() -> None:
    """Both look like an extra wheel angle that repeats."""
    for segments, is_contradicted in (
        ([sway(one, 0.08) for one in drive()], True),
        ([bend(one, 0.03) for one in drive()], False),
    ):
        witness = build_witness(segments)
        (nearest,) = [
            one
            for one in list_covariates(witness.residual_model)
            if one.description.startswith("an extra wheel angle that depends on time, repeating every 7.4 s")
        ]
        assert witness.contradicts(nearest) is is_contradicted
        share, error = witness.measure_share(nearest)
        assert (share + 2.0 * error < 0.5) is is_contradicted
