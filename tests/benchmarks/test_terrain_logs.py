"""The judging of logs by terrain: what a log was made with is found again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.benchmarks.terrain_logs import Machine, judge, read_passes
from vehicle.energy.fuel import DieselEngine
from vehicle.model.work_load import WorkLoad

GRAVITY_MPS2, MASS_KG, POWER_KW, ROLLING = 9.80665, 18_000.0, 300.0, 0.08
MACHINE = Machine(
    MASS_KG, DieselEngine(1000.0 * POWER_KW), WorkLoad(rolling_share=ROLLING, driveline_efficiency=0.8), 10_800.0
)


def write_log(path: Path, factor: float) -> None:
    """Ten passes up and down a hill at 2 m/s, 3 kg/s of crop at 3 kWh/t; fuel by D497.7 as worked out here."""
    rows = []
    for number in range(10):
        seconds = np.arange(201.0)
        north = 2.0 * seconds if number % 2 == 0 else 400.0 - 2.0 * seconds
        slope = 0.04 * np.cos(north / 80.0) * (1.0 if number % 2 == 0 else -1.0)
        push_w = MASS_KG * GRAVITY_MPS2 * (ROLLING + slope) * 2.0
        engine_kw = push_w / 0.8 / 1000.0 + 3.0 * 10.8 / 0.9
        fuel_lph = factor * (0.22 * engine_kw / POWER_KW + 0.096) * 0.9 * POWER_KW
        rows.append(
            pd.DataFrame(
                {
                    "time_s": 1000.0 * number + seconds,
                    "easting_m": 10.0 * number,
                    "northing_m": north,
                    "elevation_m": 100.0 + 3.2 * np.sin(north / 80.0),
                    "speed_mps": 2.0,
                    "fuel_lph": fuel_lph,
                    "crop_flow_kg_s": 3.0,
                }
            )
        )
    pd.concat(rows).to_csv(path, index=False)


@pytest.mark.parametrize("factor", [1.0, 1.2])
def test_fuel_of_a_made_log_is_predicted(tmp_path: Path, factor: float) -> None:
    path = tmp_path / "log.csv"
    write_log(path, factor)
    passes = read_passes(path)
    assert len(passes) == 10 and all(drive.mean_speed_mps == pytest.approx(2.0) for drive in passes)
    assert max(np.abs(passes[0].grades)) == pytest.approx(0.04, rel=0.05)
    for drive in passes:
        assert factor * MACHINE.predict_litres(drive) == pytest.approx(drive.fuel_l, rel=0.01)
    lines = judge(passes, Machine(MASS_KG, MACHINE.engine, _with_grip(), MACHINE.crop_j_per_kg), "made")
    assert "5 passes to calibrate with, 5 held out" in lines[0]
    assert "within 10 %: 100 % of passes" in lines[-1]


def test_chunks_and_gaps(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    write_log(path, 1.0)
    chunks = read_passes(path, chunk_s=50.0)
    assert len(chunks) == 40 and all(40.0 <= drive.seconds.sum() <= 50.0 for drive in chunks)


def _with_grip() -> WorkLoad:
    return WorkLoad(
        rolling_share=ROLLING, driveline_efficiency=0.8, mobility_number=200.0, engine_power_w=1000.0 * POWER_KW
    )
