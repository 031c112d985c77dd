"""One job planned in a process of its own, by any checkout of Headland: what `answers` and `growth` run.

A job is plain values (JSON): `name`, `outline` and `holes` (rings of x, y in metres), `obstacles` (each `kind`, `name`,
`half_width_m`, and `geometry` as GeoJSON), `width_m`, `speed_kmh`, `radius_m` (at full lock) and `tractors` (counts).

`plan_apart` runs this file with the Python that runs it, on the sources of a checkout. It imports nothing of these but
what the job needs, so that other checkouts need not have it. Seconds and memory are those of `plan` alone, without
starting Python: the process and the workers it started, memory of the largest of them. Linux only.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fields.geometry.field import Field
    from planner.pipeline.planning import PlanningResult
    from vehicle.model.tractor import Tractor

Job = dict[str, Any]
Answer = dict[str, Any]

LIMIT_S = 900.0
POLL_S = 0.2
KMH = 1.0 / 3.6
COPIED = (
    "tractors", "strategy", "worked_pct", "time_s", "remark", "overhang_m", "beyond_overhang_m", "outside_m",
    "excursion_m", "outside_outline_m", "over_finished_m2", "wheel_traffic_m2", "reversals", "min_clearance_m",
)  # fmt: skip
"""What an answer holds of the recommended plan, as the planner tells it."""
ROW_STEP = 3  # rows of the 10 Hz record from one measured pose to the next
SETUP = "import sys; from planner.cli.main import main; sys.argv = ['headland', 'setup']; main()"


def build_field(job: Job) -> Field:
    """The field of a job."""
    import shapely

    from fields.geometry.field import Field
    from fields.geometry.obstacles import Obstacle

    obstacles = tuple(
        Obstacle(one["kind"], shapely.from_geojson(json.dumps(one["geometry"])), one["half_width_m"], one["name"])
        for one in job["obstacles"]
    )
    return Field(job["name"], shapely.Polygon(job["outline"], job["holes"]), obstacles=obstacles)


def build_tractor(radius_m: float) -> Tractor:
    """A tractor with this radius at full lock (4 to 9 m); the wider it turns, the longer and heavier it is."""
    from vehicle.datasheet.build import build_tractor
    from vehicle.datasheet.sheet import Datasheet

    more_m = radius_m - 4.0
    sheet = Datasheet(
        wheelbase_m=2.3 + 0.2 * more_m,
        width_m=min(2.2 + 0.2 * more_m, 3.0),
        turning_radius_m=radius_m,
        mass_kg=4000.0 + 2000.0 * more_m,
    )
    return build_tractor(f"radius {radius_m:g} m", sheet)


def measure_body_outside_m(run: Any, tractor: Any, implement: Any, outline: Any) -> float:
    """How far any corner of tractor or implement, lifted, folded or not, is beyond the outline at worst, metres."""
    import numpy as np
    import shapely

    from vehicle.sim.compile import compute_contact_boxes

    worst_m, ends = 0.0, (("tail", "nose", "half_width"), ("tool_tail", "tool_front", "tool_half_width"))
    shapely.prepare(outline)
    for number in range(run.plan.tractors):
        folds = np.array([getattr(leg, "folded", False) for leg in run.plan.missions[number].legs])
        is_folded = folds[run.get_leg_numbers(number)]
        for rows, state in ((~is_folded, implement), (is_folded, getattr(implement, "folded", implement))):
            boxes = compute_contact_boxes(tractor, state)
            corners = [(boxes[end], side * boxes[half]) for *both, half in ends for end in both for side in (-1.0, 1.0)]
            x, y, angle = run.get_poses(number)[rows][::ROW_STEP].T
            for ahead, left in corners:
                east, north = np.cos(angle), np.sin(angle)
                places = np.column_stack([x + ahead * east - left * north, y + ahead * north + left * east])
                places = places[~shapely.intersects_xy(outline, places)]
                worst_m = max(worst_m, float(np.max(shapely.distance(shapely.points(places), outline), initial=0.0)))
    return worst_m


def answer_job(job: Job) -> Answer:
    """The answer of `plan` with default options: the recommended plan, or why there is none (`refused`, `crash`)."""
    from planner import HeadlandError, PlanRequest, plan

    answer: Answer = dict.fromkeys(("refused", "crash", *COPIED, "body_outside_m"))
    usage, begun = _read_cpu_s(), time.perf_counter()
    result: PlanningResult | None = None
    try:
        request = PlanRequest(width_m=job["width_m"], speed_mps=job["speed_kmh"] * KMH, tractors=tuple(job["tractors"]))
        field, tractor = build_field(job), build_tractor(job["radius_m"])
        result = plan(request, field=field, tractor=tractor)
    except HeadlandError as refusal:
        answer["refused"] = str(refusal)
    except Exception as fault:
        answer["crash"] = f"{type(fault).__name__}: {fault}"
    answer |= {"wall_s": time.perf_counter() - begun, "cpu_s": _read_cpu_s() - usage, "peak_mb": _read_peak_mb()}
    if result is None:
        return answer
    best = result.ranking.best
    if best is None or result.run is None:
        return answer | {"refused": result.ranking.refusal}
    answer |= {name: getattr(best, name, None) for name in COPIED}
    machine = result.context.tractor, result.context.implement
    outline = type(field.boundary)(field.boundary.exterior)
    return answer | {"body_outside_m": measure_body_outside_m(result.run, *machine, outline)}


def _read_cpu_s() -> float:
    """CPU seconds of this process and of those it has waited for."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def _read_peak_mb() -> float:
    """Peak memory of the largest process among this one and those it has waited for."""
    return max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) / 1024.0


def plan_apart(job: Job, checkout: Path) -> Answer:
    """The answer of a checkout to a job, from a fresh process; one that takes LIMIT_S of CPU is ended.

    `refused` is then None and `crash` says that there was no answer. Output of the planner is dropped.
    """
    command = [sys.executable, "-P", __file__, str(checkout), str(os.getpid())]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=checkout, text=True,
        env=_build_environment(checkout), start_new_session=True,
    )  # fmt: skip
    given: str | None = json.dumps(job)
    begun, used_s = time.perf_counter(), 0.0
    try:
        while True:
            try:
                output, errors = process.communicate(given, timeout=POLL_S)
                break
            except subprocess.TimeoutExpired:
                given, used_s = None, measure_session_cpu_s(process.pid)
            if used_s > LIMIT_S:
                late = {"cpu_s": used_s, "wall_s": time.perf_counter() - begun}
                return build_lost_answer(f"no answer in {LIMIT_S:.0f} s of CPU") | late
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
    if process.returncode != 0:
        return build_lost_answer(errors.strip().splitlines()[-1] if errors.strip() else f"ended {process.returncode}")
    answer: Answer = json.loads(output.splitlines()[-1])
    return answer


def build_lost_answer(crash: str) -> Answer:
    """The answer of a process that gave none."""
    return dict.fromkeys(("refused", *COPIED, "body_outside_m", "wall_s", "cpu_s", "peak_mb")) | {"crash": crash}


def compile_checkout(checkout: Path) -> None:
    """Compile what a checkout plans with, so that no job pays for it; raises SystemExit where it cannot be used."""
    done = subprocess.run(
        [sys.executable, "-P", "-c", SETUP], cwd=checkout, env=_build_environment(checkout), capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        raise SystemExit(f"The checkout {checkout} cannot be compiled: {done.stderr.strip()[-300:]}")


def _build_environment(checkout: Path) -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(checkout.resolve())}


def measure_session_cpu_s(session: int) -> float:
    """CPU seconds of all processes of a session that are running, and of those they have waited for."""
    ticks = 0
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            values = path.read_text().rpartition(")")[2].split()
        except OSError:  # it has just ended
            continue
        if int(values[3]) == session:
            ticks += sum(int(value) for value in values[11:15])
    return ticks / os.sysconf("SC_CLK_TCK")


def _end_with_starter(starter: int) -> None:
    """End this process and its workers, which are of its group, when the process that started it is no more."""
    while os.getppid() == starter:
        time.sleep(POLL_S)
    os.killpg(os.getpgid(0), signal.SIGKILL)


def main() -> None:
    """Answer the job of standard input on standard output, with the checkout named, for the process of this number."""
    import planner

    checkout, starter = Path(sys.argv[1]).resolve(), int(sys.argv[2])
    threading.Thread(target=_end_with_starter, args=(starter,), daemon=True).start()
    if checkout not in Path(planner.__file__).resolve().parents:
        raise SystemExit(f"planner is imported from {planner.__file__}, not from {checkout}.")
    print(f"\n{json.dumps(answer_job(json.load(sys.stdin)))}")


if __name__ == "__main__":
    main()
