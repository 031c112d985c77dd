"""Plan every parcel of the GeoJSON files given and print what came of it, a line per parcel.

    python -m tests.benchmarks.parcels file.geojson [...] [--tractors 1,2,3] [--width 3]

A plan counts as feasible (no contact, under 0.5 m outside the boundary) or as refused with a reason; anything else is
a fault. The last lines sum up, also for parcels over one hectare.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from multiprocessing import Pool
from pathlib import Path

from planner.evaluate import Candidate, evaluate
from planner.rank import candidates
from planner.scenario import Scenario, parse_counts
from planner.site import prepare
from reports.results import PlanResult


def parcels(path: Path) -> list[str]:
    """Names by which the polygons of a file can be read one by one."""
    data = json.loads(path.read_text(encoding="utf-8"))
    count = len(data["features"]) if data.get("type") == "FeatureCollection" else 1
    return [f"{path}#{index}" for index in range(count)] if count > 1 else [str(path)]


def work(task: tuple[str, tuple[int, ...], float]) -> dict[str, object]:
    """All plans of one parcel."""
    where, tractors, width = task
    began = time.perf_counter()
    row: dict[str, object] = {"where": where, "area_ha": None, "plans": [], "refused": None}
    try:
        scenario = Scenario(field=where, width_m=width, tractors=tractors)
        site = prepare(scenario)
        row["area_ha"] = site.layout.field.area_ha
        row["plans"] = [evaluate(site, candidate) for candidate in candidates(scenario)]
    except ValueError as refusal:
        row["refused"] = f"{type(refusal).__name__}: {refusal}"
    except Exception as fault:
        row["refused"] = f"FAULT {type(fault).__name__}: {fault}"
    row["seconds"] = time.perf_counter() - began
    return row


def main() -> None:
    """Run the sweep on all cores."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--tractors", default="1,2,3")
    parser.add_argument("--width", type=float, default=3.0)
    options = parser.parse_args()
    counts = parse_counts(options.tractors)
    evaluate(prepare(Scenario(field="iwamizawa")), Candidate("split-field", 1))
    tasks = [(where, counts, options.width) for path in options.files for where in parcels(path)]
    with Pool() as pool:
        rows = []
        for row in pool.imap(work, tasks, chunksize=1):
            print_row(row, counts)
            rows.append(row)
    summary(rows)


def print_row(row: dict[str, object], counts: tuple[int, ...]) -> None:
    """One line: parcel, area, best time per count, what was not feasible."""
    plans: list[PlanResult] = row["plans"]  # type: ignore[assignment]
    best = []
    for count in counts:
        times = [plan.time_s for plan in plans if plan.tractors == count and plan.feasible and plan.time_s]
        best.append(f"{min(times):7.0f}" if times else "      -")
    bad = [f"{p.tractors} {p.strategy}: {p.reason}" for p in plans if not p.feasible]
    area = row["area_ha"]
    name = Path(str(row["where"])).name
    print(f"{name:24} {area or 0:6.2f} ha {' '.join(best)}  {row['seconds']:5.1f} s", row["refused"] or "", flush=True)
    for line in bad:
        print("     ", line[:160])


def summary(rows: list[dict[str, object]]) -> None:
    """Totals, and the reasons counted."""
    large = [row for row in rows if (row["area_ha"] or 0) > 1]  # type: ignore[operator]
    for name, group in (("all parcels", rows), ("over 1 ha", large)):
        served = sum(any(plan.feasible for plan in row["plans"]) for row in group)  # type: ignore[attr-defined]
        print(f"{name}: {served} of {len(group)} have a feasible plan ({100 * served / max(len(group), 1):.1f} %)")
    plans = [plan for row in rows for plan in row["plans"]]  # type: ignore[attr-defined]
    print(f"plans: {sum(plan.feasible for plan in plans)} of {len(plans)} feasible")
    reasons = Counter(kind(plan) for plan in plans if not plan.feasible)
    for reason, count in reasons.most_common():
        print(f"  {count:4} {reason}")
    faults = [row for row in rows if str(row["refused"] or "").startswith("FAULT")]
    print(f"faults: {len(faults)}; slowest parcel {max(float(str(row['seconds'])) for row in rows):.1f} s")


def kind(plan: PlanResult) -> str:
    """The reason without its numbers."""
    return " ".join(word for word in (plan.reason or "no reason").split() if not any(c.isdigit() for c in word))[:80]


if __name__ == "__main__":
    main()
