"""Fuel per hectare of the jobs of ISOXML time logs: one number from half of them, judged on the other half.

    python -m tests.benchmarks.job_fuel FOLDER [--mass-kg 16500]

FOLDER holds TASKDATA.XML with logs of speed, work, fuel and harvested mass. The number is the work of the crop in kWh
per tonne. The power of the engine follows from fuel against load in the same jobs: D497.7 gives 0.316 l/h per kW of the
shaft at full load. A job is judged with its own tonnes, and with those per hectare of the other half.
"""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from planner.task_logs.formats.isoxml_logs import parse_time_log
from tests.benchmarks.terrain_logs import J_PER_KWH, Machine, PassLog
from vehicle.energy.fuel import NO_LOAD_L_PER_KWH, USE_L_PER_KWH, DieselEngine
from vehicle.energy.load import ENGINE_TO_SHAFT
from vehicle.model.work_load import WorkLoad

WORK_STATE, SPEED, AREA_M2 = "008D", "EA7E", "0074"
FUEL_ML, FUEL_MM3_PER_S, MASS_KG, LOAD_PCT = "0094", "0095", "005A", "EA6A"
MPS_PER_UNIT, LPH_PER_MM3_PER_S = 0.1 / 3.6, 0.0036
STANDING_MPS, MAX_GAP_S, MAX_STANDING_LPH = 0.1, 5.0, 60.0
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Job:
    """A job: what drove, hectares, tonnes and litres as counted, and whether its fuel while standing can be true."""

    name: str
    drive: PassLog
    area_ha: float
    mass_t: float
    fuel_l: float
    is_sound: bool


@dataclass(frozen=True, eq=False)
class TimeLog:
    """A job as logged: `time_s` (n,) from its start, `values` (n,) by DDI, NaN before the first."""

    name: str
    time_s: Floats
    values: dict[str, Floats]

    def last(self, ddi: str) -> float:
        """The last value of a counter."""
        return float(self.values[ddi][-1])


def read_logs(folder: Path) -> list[TimeLog]:
    """The logs of tasks that have just one, in the order of their names."""
    root = ElementTree.parse(next(each for each in folder.iterdir() if each.name.upper() == "TASKDATA.XML")).getroot()
    names = [[each.get("A", "") for each in task.iter("TLG")] for task in root.iter("TSK")]
    return [read_log(folder / f"{name}.xml") for name in sorted(one[0] for one in names if len(one) == 1)]


def read_log(header: Path) -> TimeLog:
    """One log; `header` is its .xml file."""
    log = parse_time_log(header.read_bytes(), header.with_suffix(".bin").read_bytes(), header.stem)
    values = {ddi: log.values[:, place] for place, (ddi, _) in enumerate(log.columns)}
    return TimeLog(header.stem, log.time_s - log.time_s[0], values)


def build_job(log: TimeLog) -> Job:
    """A job of a log; the harvested mass between two rows is what it had flowing."""
    speed = np.nan_to_num(log.values[SPEED]) * MPS_PER_UNIT
    seconds = np.minimum(np.diff(log.time_s), MAX_GAP_S)
    time_s = np.concatenate([[0.0], np.cumsum(seconds)])
    metres = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * seconds)])
    is_working = np.nan_to_num(log.values[WORK_STATE]) > 0
    fuel_lph = np.nan_to_num(log.values[FUEL_MM3_PER_S]) * LPH_PER_MM3_PER_S
    mass_kg = _span(log.values[MASS_KG])
    working_s = float(seconds[is_working[1:]].sum())
    flow = np.where(is_working, mass_kg / max(working_s, 1.0), 0.0)
    standing = (speed < STANDING_MPS) & ~is_working
    standing_lph = float(fuel_lph[standing].mean()) if standing.any() else 0.0
    drive = PassLog("", time_s, metres, np.zeros(len(speed)), speed, fuel_lph, flow)
    return Job(
        log.name, drive, _span(log.values[AREA_M2]) / 1e4, mass_kg / 1000.0, _span(log.values[FUEL_ML]) / 1000.0,
        standing_lph <= MAX_STANDING_LPH,
    )  # fmt: skip


def _span(counter: Floats) -> float:
    return float(np.nanmax(counter) - np.nanmin(counter))


def estimate_engine_kw(logs: list[TimeLog]) -> float:
    """Power of the engine (kW) from the straight line of fuel against load."""
    load = np.concatenate([log.values[LOAD_PCT] for log in logs])
    fuel = np.concatenate([log.values[FUEL_MM3_PER_S] for log in logs]) * LPH_PER_MM3_PER_S
    is_loaded = load > 20.0
    slope, constant = np.polyfit(load[is_loaded], fuel[is_loaded], 1)
    return float((100.0 * slope + constant) / (USE_L_PER_KWH + NO_LOAD_L_PER_KWH) / ENGINE_TO_SHAFT)


def predict_litres(job: Job, machine: Machine, flow_factor: float = 1.0) -> float:
    """Litres of a job; while it stands the engine idles. `flow_factor` changes the crop that is taken to flow."""
    drive = job.drive
    flow = drive.flow_kg_s * flow_factor if drive.flow_kg_s is not None else None
    total = machine.predict_litres(
        PassLog("", drive.time_s, drive.metres, drive.height_m, drive.speed_mps, drive.fuel_lph, flow)
    )
    idle_s = float(drive.seconds[(drive.speed_mps[1:] < STANDING_MPS) & (flow is None or flow[1:] == 0.0)].sum())
    no_load_l_per_s = float(machine.engine.compute_rate(np.zeros(1))[0])
    return total - idle_s * (no_load_l_per_s - machine.engine.idle_rate)


def judge(jobs: list[Job], machine: Machine) -> list[str]:
    """Lines with the errors of every second sound job; `machine` is without crop."""
    sound = [job for job in jobs if job.is_sound]
    known, held = sound[::2], sound[1::2]
    # The litres of the jobs add up with this work of the crop; fuel grows with it in a straight line.
    counted, without, with_one = (
        sum(values)
        for values in zip(
            *(
                (job.fuel_l, predict_litres(job, machine), predict_litres(job, replace(machine, crop_j_per_kg=1000.0)))
                for job in known
            ),
            strict=True,
        )
    )
    crop = 1000.0 * (counted - without) / (with_one - without)
    machine = replace(machine, crop_j_per_kg=crop)
    tonnes_per_ha = sum(job.mass_t for job in known) / sum(job.area_ha for job in known)
    litres_per_ha = sum(job.fuel_l for job in known) / sum(job.area_ha for job in known)
    own = [predict_litres(job, machine) for job in held]
    usual = [predict_litres(job, machine, tonnes_per_ha * job.area_ha / job.mass_t) for job in held]
    flat = [litres_per_ha * job.area_ha for job in held]
    return [
        f"left out as their fuel while standing cannot be true: {[job.name for job in jobs if not job.is_sound]}",
        f"{len(known)} jobs give {1000.0 * crop / J_PER_KWH:.2f} kWh per tonne; {len(held)} held out",
        f"with the tonnes of the job       {_describe(own, held)}",
        f"with usual tonnes per hectare    {_describe(usual, held)}",
        f"{litres_per_ha:.1f} l per hectare alone        {_describe(flat, held)}",
    ]


def _describe(litres: list[float], jobs: list[Job]) -> str:
    errors = np.abs([predicted / job.fuel_l - 1.0 for predicted, job in zip(litres, jobs, strict=True)])
    return (
        f"mean error {100 * errors.mean():.1f} %, worst {100 * errors.max():.1f} %, within 15 %: "
        f"{(errors <= 0.15).sum()} of {len(jobs)}"
    )


def main() -> None:
    """Judge the jobs of a folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--mass-kg", type=float, default=16_500.0)
    parser.add_argument("--rolling", type=float, default=0.08)
    parser.add_argument("--efficiency", type=float, default=0.7, help="from the engine to the axle")
    options = parser.parse_args()
    pairs = [(build_job(log), log) for log in read_logs(options.folder)]
    power_w = 1000.0 * estimate_engine_kw([log for _, log in pairs[::2]])
    load = WorkLoad(rolling_share=options.rolling, engine_power_w=power_w, driveline_efficiency=options.efficiency)
    machine = Machine(options.mass_kg, DieselEngine(power_w), load)
    print(f"engine {power_w / 1000:.0f} kW by its fuel at full load")
    print("\n".join(judge([job for job, _ in pairs], machine)))


if __name__ == "__main__":
    main()
