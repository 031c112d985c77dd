"""Simulate every candidate on the parcels of a folder; print what the quickest leave unworked and which have a plan.

    python -m tests.benchmarks.coverage FOLDER [--every 3] [--start 0] [--from-ha 1 --to-ha 60] [--reasons]

GeoJSON files (also those ending in .json) and outlines in WKT (degrees) are taken from the folder and below it. No
candidate is pruned by a bound, so feasible means driven to the end. A row has the
hectares, feasible plans of those tried per strategy (short names in the heading), the same per number of tractors, and
of the quickest plan worked (%), missed (m2), farthest outside (m), driven beyond the overhang (m), wheel traffic (m2),
clearance (m).
The smallest come first; the last lines sum up.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import shapely

from fields.documents.reader import read_field
from fields.geometry.field import Field
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.planning import plan
from planner.request.option_texts import parse_counts
from planner.request.plan_request import PlanRequest
from reports.common.plan_results import PlanResult
from tests.benchmarks.parcels import Row, add_options, count_reasons, parcels, print_reasons

ENDINGS = (".geojson", ".json", ".wkt")
WANTED_PCT, LEAST_PCT = 98.0, 95.0  # worked in the median, and on nine parcels of ten


def found(folder: Path) -> Iterator[tuple[str, Field]]:
    """Name and field of every parcel of a folder that can be read, in the order of names."""
    for path in sorted(one for one in folder.rglob("*") if one.suffix in ENDINGS):
        with tempfile.TemporaryDirectory() as space:
            source = path if path.suffix != ".wkt" else _as_geojson(path, Path(space))
            yield from _read(source)


def _read(source: Path) -> Iterator[tuple[str, Field]]:
    """The parcels of a GeoJSON file; what cannot be read is printed."""
    try:
        places = parcels(source)
    except (ValueError, KeyError) as refusal:
        print(f"{source.name}: not read, {refusal}")
        return
    for where in places:
        try:
            field = read_field(where)
        except ValueError as refusal:
            print(f"{Path(where).name}: not read, {refusal}")
            continue
        yield field.name, field


def _as_geojson(path: Path, space: Path) -> Path:
    """A file with the outline of a WKT file."""
    shape = shapely.from_wkt(path.read_text(encoding="utf-8"))
    feature = {"type": "Feature", "properties": {"id": path.stem}, "geometry": json.loads(shapely.to_geojson(shape))}
    target = space / f"{path.stem}.geojson"
    target.write_text(json.dumps(feature), encoding="utf-8")
    return target


def work(name: str, field: Field, scenario: PlanRequest) -> Row:
    """All plans of one parcel, each simulated."""
    begun = time.process_time()
    try:
        plans = plan(scenario, field=field, executor=SerialExecutor(), simulate_all=True).ranking.plans
    except ValueError as refusal:
        return Row(name, field.area_ha, seconds={"all": time.process_time() - begun}, refused=str(refusal))
    return Row(name, field.area_ha, plans=[*plans], seconds={"all": time.process_time() - begun})


def count_feasible(row: Row, **what: str | int) -> tuple[int, int]:
    """How many plans are feasible, of how many with these attributes."""
    chosen = [one for one in row.plans if all(getattr(one, name) == value for name, value in what.items())]
    return sum(one.feasible for one in chosen), len(chosen)


def line(row: Row, scenario: PlanRequest) -> str:
    """A row as it is printed."""
    shares = [count_feasible(row, strategy=name) for name in scenario.strategies]
    shares += [count_feasible(row, tractors=count) for count in scenario.tractors]
    parts = [f"{row.name[:18]:18} {row.area_ha:6.2f} {row.cpu_s:7.1f}", *(f"{done:2}/{of:<2}" for done, of in shares)]
    best = row.quickest
    if best is None:
        return " ".join([*parts, row.refused[:100] or "no feasible plan"])
    gap = "    -" if best.min_clearance_m is None else f"{best.min_clearance_m:5.2f}"
    figures = (best.missed_m2, best.outside_m, best.outside_along_m, best.wheel_traffic_m2)
    cells = " ".join(f"{value or 0.0:7.1f}" for value in figures)
    return " ".join([*parts, f"{best.worked_pct or 0.0:6.2f} {cells} {gap} {best.tractors} {best.strategy}"])


def totals(rows: list[Row], scenario: PlanRequest) -> Iterator[str]:
    """Totals over all parcels."""
    best = [row.quickest for row in rows]
    worked = sorted((one.worked_pct or 0.0) if one else 0.0 for one in best)
    tenth = worked[len(worked) // 10]
    least = sum(share >= LEAST_PCT for share in worked)
    yield f"parcels: {len(rows)}; with a plan: {sum(one is not None for one in best)}"
    yield (
        f"worked by the quickest: median {statistics.median(worked):.2f} % (wanted {WANTED_PCT:g}), a tenth below "
        f"{tenth:.2f} %, {LEAST_PCT:g} % or more on {least} of {len(rows)} parcels (wanted nine of ten)"
    )
    for name in scenario.strategies:
        shares = [f"{_planned(rows, name, count)} for {count}" for count in scenario.tractors if count > 1]
        yield f"{name}: feasible on {', '.join(shares)}"
    farthest_m = max(((one.outside_m or 0.0) for one in best if one), default=0.0)
    yield f"outside by {farthest_m:.1f} m at most, {_sum(best, 'outside_along_m'):.0f} m of driving beyond the overhang"
    yield f"wheel traffic {_sum(best, 'wheel_traffic_m2'):.0f} m2, missed {_sum(best, 'missed_m2'):.0f} m2"
    yield f"CPU {sum(row.cpu_s for row in rows):.0f} s, worst parcel {max(row.cpu_s for row in rows):.0f} s"
    yield from count_reasons(rows)


def _planned(rows: list[Row], strategy: str, tractors: int) -> str:
    done = sum(count_feasible(row, strategy=strategy, tractors=tractors)[0] > 0 for row in rows)
    return f"{done} of {len(rows)} ({100.0 * done / len(rows):.0f} %)"


def _sum(plans: Iterable[PlanResult | None], name: str) -> float:
    return float(sum(getattr(one, name) or 0.0 for one in plans if one))


def parsed() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--start", type=int, default=0, help="begin with this one of them, from 0")
    parser.add_argument("--only", default="", help="names, separated by commas")
    add_options(parser, 1.0, 60.0)
    parser.add_argument("--headland", type=float, default=None)
    return parser.parse_args()


def main() -> None:
    """One parcel after another in this process."""
    options = parsed()
    counts = parse_counts(options.tractors)
    scenario = PlanRequest(width_m=options.width, headland_m=options.headland, tractors=counts)
    wanted = [one for one in found(options.folder) if options.from_ha < one[1].area_ha <= options.to_ha]
    wanted = sorted(wanted[options.start :: options.every], key=lambda one: round(one[1].area_ha, 4))
    only = set(options.only.split(",")) - {""}
    heads = " ".join(f"{name[:3] + name[-1]:>5}" for name in scenario.strategies)
    print(f"{'parcel':18} {'ha':>6} {'CPU s':>7} {heads} {' '.join(f'{n:4} t' for n in counts)}"
          "  worked  missed    path outline traffic  gap", flush=True)  # fmt: skip
    rows = []
    for name, field in wanted:
        if only and name not in only:
            continue
        rows.append(work(name, field, scenario))
        print(line(rows[-1], scenario), flush=True)
        if options.reasons:
            print_reasons(rows[-1])
    if rows:
        print("\n".join(totals(rows, scenario)))


if __name__ == "__main__":
    main()
