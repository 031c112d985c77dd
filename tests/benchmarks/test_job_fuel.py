"""The judging of jobs by their fuel: jobs that were made with a model give its number back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.benchmarks.job_fuel import Job, calibrate_crop_j_per_kg, judge, predict_litres
from tests.benchmarks.terrain_logs import Machine, PassLog
from vehicle.energy.fuel import DieselEngine
from vehicle.model.work_load import WorkLoad

MACHINE = Machine(16_500.0, DieselEngine(400_000.0), WorkLoad(rolling_share=0.08, driveline_efficiency=0.7))
CROP_J_PER_KG = 2000.0


def make_job(number: int) -> Job:
    """Ten minutes of standing and 20 of work at 1.5 m/s; the crop differs from job to job."""
    time_s = np.arange(1801.0)
    is_working = time_s > 600.0
    speed, flow = np.where(is_working, 1.5, 0.0), np.where(is_working, 20.0 + 5.0 * number, 0.0)
    metres = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))])
    drive = PassLog("", time_s, metres, 0.0 * metres, speed, None, flow)
    job = Job(str(number), drive, 1.0, float(flow.sum()) / 1000.0, 0.0, is_sound=True)
    return replace(job, fuel_l=predict_litres(job, replace(MACHINE, crop_j_per_kg=CROP_J_PER_KG)))


def test_the_work_of_the_crop_is_found_and_predicts_the_others() -> None:
    jobs = [make_job(number) for number in range(6)]
    assert calibrate_crop_j_per_kg(jobs[::2], MACHINE) == pytest.approx(CROP_J_PER_KG)
    lines = judge([*jobs, replace(jobs[0], is_sound=False)], MACHINE)
    assert "['0']" in lines[0] and lines[1].startswith("3 jobs give 0.56 kWh per tonne; 3 held out")
    assert "mean error 0.0 %, worst 0.0 %, within 15 %: 3 of 3" in lines[2]
    assert "mean error 0.0 %" not in lines[4]


def test_a_standing_machine_idles() -> None:
    """Ten minutes at the idle rate, and work by D497.7 worked out here: rolling and crop over 20 minutes."""
    job = make_job(0)
    push_kw = 0.08 * 16.5 * 9.80665 * 1.5
    lph = (0.22 * (push_kw / 0.7 + 20.0 * 2.0 / 0.9) / 400.0 + 0.096) * 360.0
    assert job.fuel_l == pytest.approx(lph / 3.0 + 0.07 * 0.316 * 360.0 / 6.0, rel=0.01)
