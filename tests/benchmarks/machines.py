"""Plan ordinary machines at ordinary speeds on real parcels with obstacles, fences and entrances set in by a seed.

    python -m tests.benchmarks.machines FOLDER [--parcels 8] [--seed 1] [--machines 4m,6m@r55] [--json FILE]
    python -m tests.benchmarks.machines FOLDER --case dk-004:6m@r55:5:fence [--save field.geojson]
    python -m tests.benchmarks.machines --shapes

Parcels are drawn from the GeoJSON files of the folder. Every parcel gets one number of obstacles and one kind of edge,
so that four parcels see every number and every kind (`--conditions all` for the whole product), and is planned with
every machine, each behind the tractor that usually pulls it (`--tractors all` for the product), with one tractor
(row-by-row-optimised) and, where there is room, a formation of two (row-by-row). 3 m at 5 km/h on the same field is the
reference of CPU per simulated kilometre. A row tells case, whether the implement fits, worked (%), the same of what its
bar can reach, guided path and outline outside (m), longest way in reverse (m), CPU (s), CPU against the reference,
formation, and why there is no plan. `--shapes` plans odd shapes instead. `--json` appends a row per case to a file of
JSON lines; `--compare` names an earlier one.

"""

import argparse
import itertools
import json
import math
import random
import statistics
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely

from fields.documents.writer import write_field
from fields.geometry.field import Field
from fields.geometry.obstacles import Obstacle
from tests.benchmarks.machine_cases import MACHINES, REFERENCE, TRACTORS, Machine, Row, plan_field, run_case
from tests.benchmarks.machine_fields import EDGES, OBSTACLE_COUNTS, Condition, build_field
from tests.benchmarks.parcels import iter_parcels

ASKED = "asked: 99 % feasible, worked median 99.5 %, tenth 98 %, formations 90 %, CPU ratio at most 1.5"
SHAPE_MACHINES = (REFERENCE, next(one for one in MACHINES if one.key == "4m"))
SAME_PCT = 0.05


def build_odd_shapes() -> dict[str, Field]:
    """The fields by their names."""
    ring = shapely.Point(0.0, 0.0).buffer(70.0, quad_segs=12).difference(shapely.Point(0.0, 0.0).buffer(60.0))
    lane = shapely.box(120, 42, 190, 48)
    trees = list_points(range(18, 73, 6), range(15, 46, 6), "tree", 0.5)
    poles = list_points(range(12, 145, 14), range(9, 115, 14), "pole", 0.25)
    rows = list_rows(10.0, 120.0, [5.0 + 4.0 * number for number in range(14)], 0.25)
    ditch = Obstacle("ditch", shapely.LineString([(-5, 50), (185, 65)]), 0.75)
    shapes: dict[str, tuple[shapely.Polygon, Iterable[Obstacle]]] = {
        "orchard": (shapely.box(0, 0, 90, 60), trees),
        "vineyard": (shapely.box(0, 0, 130, 62), rows),
        "pivot-circle": (shapely.Point(0, 0).buffer(100.0), [Obstacle("pole", shapely.Point(0, 0), 0.5)]),
        "triangle": (shapely.Polygon([(0, 0), (210, 0), (60, 150)]), ()),
        "hourglass-8": (build_hourglass(8.0), ()),
        "hourglass-5": (build_hourglass(5.0), ()),
        "ditch-across": (shapely.box(0, 0, 180, 120), [ditch]),
        "strip-8": (shapely.box(0, 0, 220, 8), ()),
        "garden": (shapely.box(0, 0, 36, 28), ()),
        "points-400": (build_waved_outline(400), ()),
        "two-parts": (shapely.union_all([shapely.box(0, 0, 120, 90), lane, shapely.box(190, 0, 300, 80)]), ()),
        "thin-ring": (ring, ()),
        "l-shape": (shapely.Polygon([(0, 0), (500, 0), (500, 180), (200, 180), (200, 550), (0, 550)]), ()),
        "hole-1-ha": (shapely.box(0, 0, 105, 100).difference(shapely.box(40, 38, 62, 60)), ()),
        "points-all-over": (shapely.box(0, 0, 150, 120), poles),
    }
    return {name: Field(name, shape, obstacles=tuple(obstacles)) for name, (shape, obstacles) in shapes.items()}


def build_hourglass(neck_m: float) -> shapely.Polygon:
    """Two trapeziums of 100 m that meet in a neck of 10 m length."""
    half = 0.5 * neck_m
    west, east = [(100, half), (0, 50), (0, -50), (100, -half)], [(110, -half), (210, -50), (210, 50), (110, half)]
    return shapely.Polygon([*west, *east])


def build_waved_outline(points: int) -> shapely.Polygon:
    """An ellipse with waves of several lengths, about 3.3 ha."""
    angle = math.tau * np.arange(points) / points
    reach = 1.0 + 0.08 * np.sin(3 * angle + 0.4) + 0.05 * np.sin(7 * angle) + 0.01 * np.sin(31 * angle + 1.0)
    return shapely.Polygon(np.column_stack([130.0 * reach * np.cos(angle), 80.0 * reach * np.sin(angle)]))


def list_points(xs: Iterable[int], ys: Iterable[int], kind: str, radius_m: float) -> tuple[Obstacle, ...]:
    """Round obstacles on a grid."""
    heights = list(ys)
    return tuple(Obstacle(kind, shapely.Point(x, y), radius_m, f"{x}/{y}") for x in xs for y in heights)


def list_rows(west: float, east: float, ys: Iterable[float], half_m: float) -> tuple[Obstacle, ...]:
    """Rows of plants from west to east."""
    lines = (shapely.LineString([(west, y), (east, y)]) for y in ys)
    return tuple(Obstacle("hedge", line, half_m, f"row {number}") for number, line in enumerate(lines))


def choose_machines(keys: str, tractors: str) -> list[Machine]:
    """The machines of keys such as "4m,6m@eg105", all by default; with tractors "all" each behind every tractor."""
    known = {one.key: one for one in (REFERENCE, *MACHINES)}
    chosen = []
    for key in keys.split(",") if keys else [one.key for one in MACHINES]:
        name, _, tractor = key.partition("@")
        if name not in known or (tractor and tractor not in TRACTORS):
            raise SystemExit(f"Machine {key!r} is unknown; use {', '.join(known)}, with @{', @'.join(TRACTORS)}.")
        machine = replace(known[name], tractor=tractor or known[name].tractor)
        chosen += [replace(machine, tractor=one) for one in TRACTORS] if tractors == "all" else [machine]
    return chosen


def choose_conditions(number: int, choice: str) -> list[Condition]:
    """The conditions of the parcel drawn as this number: one of a Latin square, or all."""
    if choice == "all":
        return [Condition(count, edge) for count, edge in itertools.product(OBSTACLE_COUNTS, EDGES)]
    edge = EDGES[(number + number // len(OBSTACLE_COUNTS)) % len(EDGES)]
    return [Condition(OBSTACLE_COUNTS[number % len(OBSTACLE_COUNTS)], edge)]


def draw_parcels(folder: Path, count: int, seed: int, from_ha: float, to_ha: float) -> list[Field]:
    """So many parcels of a folder, in an order drawn by the seed."""
    parcels = [field for field in iter_parcels(folder) if from_ha <= field.area_ha <= to_ha]
    parcels.sort(key=lambda field: field.name)
    random.Random(seed).shuffle(parcels)
    return parcels[:count]


def iter_rows(options: argparse.Namespace) -> Iterator[Row]:
    """The cases of the command line, the reference of a field before its machines."""
    machines = choose_machines(options.machines, options.tractors)
    parcels = draw_parcels(options.folder, options.parcels, options.seed, options.from_ha, options.to_ha)
    for number, parcel in list(enumerate(parcels))[options.start :]:
        for condition in choose_conditions(number, options.conditions):
            first = run_case(parcel, condition, REFERENCE, options.seed, with_formation=False, reference=None)
            per_km = first.cpu_s / first.driven_km if first.feasible and first.driven_km else None
            yield replace(first, reference_cpu_s_per_km=per_km)
            for machine in machines:
                yield run_case(parcel, condition, machine, options.seed, not options.no_formations, per_km)


def run_shapes(options: argparse.Namespace) -> Iterator[Row]:
    """The odd shapes with 3 m at 5 km/h and an ordinary machine, or the machines asked for."""
    machines = choose_machines(options.machines, options.tractors) if options.machines else SHAPE_MACHINES
    only = set(options.only.split(",")) - {""}
    for name, field in build_odd_shapes().items():
        for machine in machines if not only or name in only else ():
            yield plan_field(field, f"{name}:{machine.name}", machine, Condition(), not options.no_formations, None)


def run_single_case(options: argparse.Namespace) -> Iterator[Row]:
    """The case of a name such as dk-004:6m@r55:5:fence; with `--save` its field is written to a file."""
    name, machine_key, count, edge = options.case.split(":")
    parcel = next((field for field in iter_parcels(options.folder) if field.name == name), None)
    if parcel is None:
        raise SystemExit(f"There is no parcel {name!r} in {options.folder}.")
    condition, machine = Condition(int(count), edge), choose_machines(machine_key, "")[0]
    if options.save is not None:
        write_field(build_field(parcel, condition, options.seed), options.save)
    yield run_case(parcel, condition, machine, options.seed, not options.no_formations, None)


def format_row(row: Row) -> str:
    """One line of the table."""
    fit = "wide" if row.is_wide else "fits" if row.fits else "-"
    numbers = (
        (row.worked_pct, 2),
        (row.worked_of_reachable_pct, 2),
        (row.excursion_m, 2),
        (row.overhang_m, 2),
        (row.longest_reverse_m, 0),
    )
    cells = " ".join(f"{'-' if value is None else f'{value:.{digits}f}':>6}" for value, digits in numbers)
    ratio = "-" if row.cpu_ratio is None else f"{row.cpu_ratio:.2f}"
    pair = {None: "-", True: "yes", False: "NO"}[row.formation_feasible]
    why = f"CRASH {row.crash}" if row.crash else row.reason or ""
    verdict = "yes" if row.feasible else "NO"
    return (
        f"{row.case:32} {row.area_ha:6.2f} {fit:4} {verdict:3} {cells} {row.cpu_s:6.1f} {ratio:>6} {pair:3} {why[:110]}"
    )


def print_rows(rows: Iterable[Row], target: Path | None, details: bool) -> list[Row]:
    """Every row as it comes, on the screen and in the file; all of them."""
    heads = f"{'worked':>6} {'reach':>6} {'path':>6} {'outl.':>6} {'rev.':>6} {'CPU s':>6} {'ratio':>6} two"
    print(f"{'case':32} {'ha':>6} fit  ok  {heads}", flush=True)
    done = []
    for row in rows:
        done.append(row)
        print(format_row(row), flush=True)
        for place in (*row.where, *row.formation_where) if details else ():
            print(f"      {place}", flush=True)
        if details and row.formation_reason:
            print(f"      two tractors: {row.formation_reason}", flush=True)
        if target is not None:
            with target.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row.to_values()) + "\n")
    return done


def summarise(rows: Sequence[Row]) -> Iterator[str]:
    """A line per machine and one for all but the reference."""
    by_machine = defaultdict(list)
    for row in rows:
        by_machine[row.machine].append(row)
    yield (
        f"{'group':14} cases  fit feasible  worked  tenth  of reach  tenth path m  over m rev. m wide  two CPU ratio"
        " lost CPU s"
    )
    for name, group in by_machine.items():
        yield summarise_group(name, group)
    ordinary = [row for row in rows if row.machine != REFERENCE.name]
    for condition in sorted({row.condition.split(":")[0] for row in ordinary}, key=int):
        group = [row for row in ordinary if row.condition.split(":")[0] == condition]
        yield summarise_group(f"{condition} obstacles", group)
    yield summarise_group("all", ordinary)
    yield ASKED


def summarise_group(name: str, rows: Sequence[Row]) -> str:
    """Shares, quantiles and extremes of some rows; without a plan a field that fits counts as worked not at all."""
    fitting = [row for row in rows if row.fits]
    wide = [row for row in fitting if row.formation_feasible is not None]
    worked = compute_quantiles([(row.worked_pct or 0.0) if row.feasible else 0.0 for row in fitting])
    reached = compute_quantiles([(row.worked_of_reachable_pct or 0.0) if row.feasible else 0.0 for row in fitting])
    driven = [row for row in rows if row.feasible]
    extremes = [
        max((getattr(row, key) or 0.0 for row in driven), default=0.0)
        for key in ("excursion_m", "overhang_m", "longest_reverse_m")
    ]
    compared = [row for row in driven if row.cpu_ratio is not None]
    spent = sum(row.cpu_s for row in compared)
    usual = sum((row.driven_km or 0.0) * (row.reference_cpu_s_per_km or 0.0) for row in compared)
    ratio = spent / usual if usual else 0.0
    lost_s = max((row.cpu_s for row in rows if not row.feasible), default=0.0)
    pair = compute_share_pct(wide, lambda row: bool(row.formation_feasible))
    return (
        f"{name:14} {len(rows):5} {len(fitting):4} {compute_share_pct(fitting, lambda row: row.feasible):7.1f}% "
        f"{worked[0]:7.2f} {worked[1]:6.2f} {reached[0]:9.2f} {reached[1]:6.2f} {extremes[0]:6.2f} {extremes[1]:7.2f} "
        f"{extremes[2]:6.0f} {len(wide):4} {pair:3.0f}% {ratio:9.2f} {lost_s:10.1f}"
    )


def compute_quantiles(values: Iterable[float]) -> tuple[float, float]:
    """Median and tenth percentile; 0 without values."""
    ordered = sorted(values)
    return (statistics.median(ordered), ordered[len(ordered) // 10]) if ordered else (0.0, 0.0)


def compute_share_pct(rows: Sequence[Row], holds: Callable[[Row], bool]) -> float:
    """Share of rows of which something holds, percent; 0 without rows."""
    return 100.0 * sum(holds(row) for row in rows) / len(rows) if rows else 0.0


def group_reasons(rows: Iterable[Row]) -> Iterator[str]:
    """Why there is no plan or no formation, the most frequent first, each with its cases."""
    groups = defaultdict(list)
    for row in rows:
        mark = "" if row.fits else " (does not fit)"
        if not row.feasible:
            groups[f"{strip_numbers(row.crash or row.reason or '')}{mark}"].append(row.case)
        if row.formation_feasible is False:
            groups[f"two: {strip_numbers(row.formation_reason or '')}"].append(row.case)
    for reason, cases in sorted(groups.items(), key=lambda one: (-len(one[1]), one[0])):
        yield f"{len(cases):4} {reason}: {', '.join(cases[:4])}"


def strip_numbers(reason: str) -> str:
    """A sentence without the words that hold numbers, so that like ones can be counted."""
    return " ".join(word for word in reason.split() if not any(letter.isdigit() for letter in word))[:100]


def compare_rows(rows: Iterable[Row], before: Path) -> Iterator[str]:
    """Cases that were won or lost, or worked otherwise, since a run of which the rows are in a file."""
    lines = before.read_text(encoding="utf-8").splitlines()
    earlier = {values["case"]: values for values in map(json.loads, lines)}
    for row in rows:
        old = earlier.get(row.case)
        if old is None:
            continue
        if old["feasible"] != row.feasible:
            yield f"{'won ' if row.feasible else 'LOST'} {row.case}: {old['reason'] or row.crash or row.reason}"
        elif row.feasible and abs((row.worked_pct or 0.0) - (old["worked_pct"] or 0.0)) > SAME_PCT:
            yield f"     {row.case}: worked {old['worked_pct']:.2f}, now {row.worked_pct:.2f} %"
        if (old["formation_feasible"], row.formation_feasible) in ((True, False), (False, True)):
            yield f"{'won ' if row.formation_feasible else 'LOST'} two {row.case}: {row.formation_reason or ''}"


def parse_options() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--parcels", type=int, default=8)
    parser.add_argument("--start", type=int, default=0, help="begin with this one of the parcels drawn, from 0")
    parser.add_argument("--seed", type=int, default=1, help="draws parcels, obstacles, fences and entrances")
    parser.add_argument("--machines", default="", help="some of 3m5,3m,4m,6m,9m,12m,24m,36m, with @tractor if need be")
    parser.add_argument("--tractors", choices=("usual", "all"), default="usual")
    parser.add_argument("--conditions", choices=("one", "all"), default="one")
    parser.add_argument("--from-ha", type=float, default=0.5)
    parser.add_argument("--to-ha", type=float, default=8.0)
    parser.add_argument("--no-formations", action="store_true")
    parser.add_argument("--shapes", action="store_true", help="odd shapes instead of parcels")
    parser.add_argument("--only", default="", help="some of the odd shapes")
    parser.add_argument("--case", default="", help="one case, by its name")
    parser.add_argument("--save", type=Path, help="with --case: write its field, for headland plan")
    parser.add_argument("--details", action="store_true", help="say where plans fail")
    parser.add_argument("--json", type=Path, help="append rows to this file of JSON lines")
    parser.add_argument("--compare", type=Path, help="rows of an earlier run")
    options = parser.parse_args()
    if options.folder is None and not options.shapes:
        parser.error("give a folder with field files, or --shapes")
    return options


def main() -> None:
    """One case after another in this process, after one that compiles everything."""
    options = parse_options()
    plan_field(build_odd_shapes()["garden"], "warm-up", REFERENCE, Condition(), True, None)
    begun = time.process_time()
    source = run_shapes if options.shapes else run_single_case if options.case else iter_rows
    rows = print_rows(source(options), options.json, options.details or bool(options.case))
    print("\n".join((*summarise(rows), *group_reasons(rows))))
    if options.compare is not None:
        print("\n".join(compare_rows(rows, options.compare)))
    print(f"CPU {time.process_time() - begun:.0f} s")


if __name__ == "__main__":
    main()
