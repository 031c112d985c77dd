"""Fuel and speed of a real log by terrain and load: one calibration on half of its passes, judged on the other half.

    python -m tests.benchmarks.terrain_logs LOG.csv --mass-kg 18000 --power-kw 323 --rolling 0.08 [--chunk-s 60]

A log is a table with time_s, elevation_m and speed_mps, places as lat and lon or easting_m and northing_m, and, where
there are, fuel_lph and crop_flow_kg_s. Rows are counted for each machine and piece of the log by the columns `machine`
and `log`. Passes are straight drives of a minute or more, or with --chunk-s pieces of that many seconds; every second
one is for the calibration. Heights are averaged over 25 m either way, as receivers err by more than a slope of a metre.
"""

import argparse
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from vehicle.energy.fuel import DieselEngine
from vehicle.energy.run_energy import compute_consumption, compute_motion_work
from vehicle.energy.traction import compute_motion_resistance, solve_slips
from vehicle.model.work_load import WorkLoad

SMOOTHING_M, GRADE_M = 25.0, 20.0
MIN_PASS_S, MAX_GAP_S, STRAIGHT_RAD, MIN_SPEED_MPS = 60.0, 5.0, 0.12, 0.3
S_PER_H, J_PER_KWH, METRES_PER_DEG = 3600.0, 3.6e6, 111_320.0
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PassLog:
    """One pass: `time_s`, `metres` driven so far, `height_m`, `speed_mps`, fuel and crop flow (n,), or None without."""

    machine: str
    time_s: Floats
    metres: Floats
    height_m: Floats
    speed_mps: Floats
    fuel_lph: Floats | None
    flow_kg_s: Floats | None

    @property
    def seconds(self) -> Floats:
        """Length of each interval (n - 1,)."""
        return np.diff(self.time_s)

    @property
    def mean_speed_mps(self) -> float:
        """Way over time."""
        return float((self.metres[-1] - self.metres[0]) / (self.time_s[-1] - self.time_s[0]))

    @property
    def grades(self) -> Floats:
        """Rise per metre in the direction of travel (n,), over GRADE_M either way."""
        ahead = np.interp(self.metres + GRADE_M, self.metres, self.height_m)
        behind = np.interp(self.metres - GRADE_M, self.metres, self.height_m)
        reach = np.minimum(self.metres + GRADE_M, self.metres[-1]) - np.maximum(self.metres - GRADE_M, self.metres[0])
        return np.asarray((ahead - behind) / np.maximum(reach, 1.0))

    @property
    def fuel_l(self) -> float:
        """Litres as logged."""
        assert self.fuel_lph is not None
        return float((0.5 * (self.fuel_lph[1:] + self.fuel_lph[:-1]) * self.seconds).sum() / S_PER_H)


@dataclass(frozen=True)
class Machine:
    """What is taken as known of a machine: mass, engine, resistance to rolling and work of the crop per kilogram."""

    mass_kg: float
    engine: DieselEngine
    load: WorkLoad
    crop_j_per_kg: float = 0.0
    air_n_s2_per_m2: float = 0.0

    def predict_litres(self, drive: PassLog) -> float:
        """Litres of a pass by its speeds, heights and crop."""
        count = len(drive.seconds)
        ways = np.diff(drive.metres)
        rolling = np.full(count, self.load.rolling_share)
        air = self.air_n_s2_per_m2 * drive.speed_mps[1:] ** 2 / (self.mass_kg * 9.80665)
        work = compute_motion_work(
            ways,
            np.diff(drive.height_m),
            drive.speed_mps,
            self.mass_kg,
            self.load,
            rolling + air,
            np.zeros(count, bool),
        )
        crop = np.zeros(count)
        if drive.flow_kg_s is not None:
            crop = self.crop_j_per_kg * 0.5 * (drive.flow_kg_s[1:] + drive.flow_kg_s[:-1]) * drive.seconds
        return float(compute_consumption(work, crop, drive.seconds, self.load, self.engine).sum())

    def predict_mean_speed(self, drive: PassLog, set_speed_mps: float) -> float:
        """Mean speed of a pass whose wheels turn as at `set_speed_mps` on level ground: slopes change their slip."""
        mobility, rolling = self.load.mobility_number, self.load.rolling_share
        assert mobility is not None and rolling is not None
        level, here = (
            1.0 - solve_slips(np.atleast_1d(grades), mobility, self.load.max_slip) for grades in (0.0, drive.grades)
        )
        speeds = set_speed_mps * here / level
        needed_w = (np.maximum(drive.grades, 0.0) + rolling) * self.mass_kg * 9.80665 * speeds
        speeds *= np.minimum(self.load.axle_power_w / np.maximum(needed_w, 1.0), 1.0)
        weights = np.gradient(drive.metres)
        return float(weights.sum() / (weights / speeds).sum())


def _cut_passes(table: pd.DataFrame, chunk_s: float | None) -> list[PassLog]:
    needed = ["time_s", "elevation_m", "speed_mps"] + (["fuel_lph"] if "fuel_lph" in table else [])
    table = table.dropna(subset=needed).reset_index(drop=True)
    time_s, places = table["time_s"].to_numpy(float), _get_places(table)
    steps = np.hypot(*np.diff(places, axis=0).T)
    metres = np.concatenate([[0.0], np.cumsum(steps)])
    heights = _smooth(metres, table["elevation_m"].to_numpy(float))
    names = table["machine"].astype(str) if "machine" in table else None
    fuel = table["fuel_lph"].to_numpy(float) if "fuel_lph" in table else None
    flow = table["crop_flow_kg_s"].to_numpy(float) if "crop_flow_kg_s" in table else None
    speed = table["speed_mps"].to_numpy(float)
    passes = []
    for first, last in _find_pieces(time_s, places, speed, chunk_s):
        piece = slice(first, last)
        passes.append(
            PassLog(
                "" if names is None else names.iloc[first], time_s[piece], metres[piece], heights[piece], speed[piece],
                None if fuel is None else fuel[piece], None if flow is None else flow[piece],
            )
        )  # fmt: skip
    return passes


def _get_places(table: pd.DataFrame) -> Floats:
    if "easting_m" in table:
        return table[["easting_m", "northing_m"]].to_numpy(float)
    lat, lon = table["lat"].to_numpy(float), table["lon"].to_numpy(float)
    east = (lon - lon.mean()) * METRES_PER_DEG * np.cos(np.radians(lat.mean()))
    return np.column_stack([east, (lat - lat.mean()) * METRES_PER_DEG])


def _smooth(metres: Floats, heights: Floats) -> Floats:
    """Straight lines fitted to the heights within SMOOTHING_M either way, at their middles."""
    low = np.searchsorted(metres, metres - SMOOTHING_M)
    high = np.searchsorted(metres, metres + SMOOTHING_M, side="right")

    def sum_window(values: Floats) -> Floats:
        total = np.concatenate([[0.0], np.cumsum(values)])
        return total[high] - total[low]

    count, way, height = high - low, sum_window(metres), sum_window(heights)
    spread = count * sum_window(metres**2) - way**2
    slope = np.divide(
        count * sum_window(metres * heights) - way * height, spread, out=np.zeros_like(metres), where=spread > 1e-6
    )
    return np.asarray(height / count + slope * (metres - way / count))


def _find_pieces(time_s: Floats, places: Floats, speed: Floats, chunk_s: float | None) -> list[tuple[int, int]]:
    """First row and the row after the last of each pass."""
    gap = np.diff(time_s) > MAX_GAP_S
    if chunk_s is not None:
        number = (time_s // chunk_s).astype(int)
        breaks = gap | (np.diff(number) != 0)
    else:
        steps = np.diff(places, axis=0)
        heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        reach = max(1, round(5.0 / max(float(np.median(np.diff(time_s))), 0.1)))
        bend = np.zeros(len(heading))
        bend[:-reach] = np.abs(heading[reach:] - heading[:-reach])
        breaks = gap | (bend > STRAIGHT_RAD) | (speed[1:] < MIN_SPEED_MPS) | (np.abs(np.diff(time_s)) < 1e-9)
    edges = np.concatenate([[0], np.flatnonzero(breaks) + 1, [len(time_s)]])
    shortest = MIN_PASS_S if chunk_s is None else 0.8 * chunk_s
    return [
        (int(first), int(last))
        for first, last in pairwise(edges)
        if last - first > 3 and time_s[last - 1] - time_s[first] >= shortest
    ]


def judge(passes: list[PassLog], machine: Machine, name: str) -> list[str]:
    """Lines that say how far fuel and speed of every second pass are off, after a calibration on the others."""
    known, held = passes[::2], passes[1::2]
    speed_mps = float(np.mean([drive.mean_speed_mps for drive in known]))
    plain = [speed_mps / drive.mean_speed_mps - 1.0 for drive in held]
    slope = [machine.predict_mean_speed(drive, speed_mps) / drive.mean_speed_mps - 1.0 for drive in held]
    lines = [
        f"{name}: {len(known)} passes to calibrate with, {len(held)} held out",
        f"  pass speed, set speed alone      {_describe(plain, 0.02)}",
        f"  pass speed, with slip and power  {_describe(slope, 0.02)}",
        f"  within passes: {_describe_profile(held, machine)}",
    ]
    if all(drive.fuel_lph is not None for drive in passes):
        mean_l_per_s = sum(drive.fuel_l for drive in known) / sum(drive.seconds.sum() for drive in known)
        flat = [mean_l_per_s * drive.seconds.sum() / drive.fuel_l - 1.0 for drive in held]
        plain = [machine.predict_litres(drive) / drive.fuel_l - 1.0 for drive in held]
        factor = sum(drive.fuel_l for drive in known) / sum(machine.predict_litres(drive) for drive in known)
        scaled = [factor * (1.0 + error) - 1.0 for error in plain]
        lines += [
            f"  fuel, litres per hour alone      {_describe(flat, 0.10)}",
            f"  fuel, nothing fitted             {_describe(plain, 0.10)}",
            f"  fuel, one factor of {factor:.3f}        {_describe(scaled, 0.10)}",
        ]
    return lines


def _describe(errors: list[float], limit: float) -> str:
    sizes = np.abs(errors)
    share = 100.0 * float(np.mean(sizes <= limit))
    return (
        f"mean error {100 * np.mean(sizes):5.1f} %, median {100 * np.median(sizes):5.1f} %, bias "
        f"{100 * np.mean(errors):+5.1f} %, within {100 * limit:.0f} %: {share:.0f} % of passes"
    )


def _describe_profile(passes: list[PassLog], machine: Machine) -> str:
    """How speed over the mean of the pass changes with slope, logged and by slip."""
    grades = np.concatenate([drive.grades - drive.grades.mean() for drive in passes])
    ratios = np.concatenate([drive.speed_mps / drive.speed_mps.mean() - 1.0 for drive in passes])
    logged = float((grades * ratios).sum() / (grades**2).sum())
    mobility = machine.load.mobility_number or 50.0
    slips = solve_slips(np.array([-0.01, 0.01]), mobility, 0.3)
    return f"{logged:+.2f} % of speed per % of slope as logged, {-50.0 * (slips[1] - slips[0]):+.2f} by slip"


def main() -> None:
    """Judge a log."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", type=Path)
    parser.add_argument("--mass-kg", type=float, required=True)
    parser.add_argument("--power-kw", type=float, required=True, help="of the engine")
    parser.add_argument("--mobility", type=float, default=50.0, help="mobility number of the driven wheels")
    parser.add_argument("--rolling", type=float, help="resistance over weight, by default from the mobility number")
    parser.add_argument("--efficiency", type=float, default=0.86, help="from the engine to the axle")
    parser.add_argument("--crop-kwh-per-t", type=float, default=0.0)
    parser.add_argument("--air", type=float, default=0.0, help="N s2/m2")
    parser.add_argument("--chunk-s", type=float)
    options = parser.parse_args()
    rolling = options.rolling or float(compute_motion_resistance(0.0, options.mobility))
    load = WorkLoad(
        rolling_share=rolling, engine_power_w=1000.0 * options.power_kw, driveline_efficiency=options.efficiency,
        mobility_number=options.mobility,
    )  # fmt: skip
    engine = DieselEngine(1000.0 * options.power_kw)
    crop_j_per_kg = options.crop_kwh_per_t * J_PER_KWH / 1000.0
    machine = Machine(options.mass_kg, engine, load, crop_j_per_kg, options.air)
    table = pd.read_csv(options.log)
    groups = [name for name in ("machine", "log") if name in table]
    parts = [part for _, part in table.groupby(groups, sort=False)] if groups else [table]
    passes = [drive for part in parts for drive in _cut_passes(part, options.chunk_s)]
    for name in dict.fromkeys(drive.machine for drive in passes):
        print("\n".join(judge([drive for drive in passes if drive.machine == name], machine, name or options.log.stem)))


if __name__ == "__main__":
    main()
