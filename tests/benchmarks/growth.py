"""CPU and memory of default plans against hectares, tractors and obstacles, and the exponents by which they grow.

    python -m tests.benchmarks.growth [--most-ha 500] [--most-tractors 100] [--most-obstacles 200] [--against CHECKOUT]

Every plan is made in a process of its own, at 6 m and 10 km/h. Fields are nearly square, 1 to 500 ha; 1 to 100 tractors
work 50 ha, exactly so many in each plan; 0 to 200 poles and groups of trees stand on 20 ha, those of a smaller number
among those of a larger one. Fields and obstacles are planned for `--tractors`, by default 1 to 6 as `headland plan`
does. An exponent is the slope of the logarithms over the upper half of the sizes that have a plan. A plan that takes
900 s of CPU is ended, and larger ones of its row are not tried. A most of 0 leaves a row of sizes out. `--against` has
another checkout plan the same right after (base).
"""

import argparse
import math
import random
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import shapely

from fields.geometry.obstacles import Obstacle
from planner.request.option_texts import parse_counts
from tests.benchmarks.answers import ROOT, is_planned
from tests.benchmarks.drawn_jobs import build_job
from tests.benchmarks.machine_fields import draw_obstacles
from tests.benchmarks.planned_jobs import LIMIT_S, Answer, Job, compile_checkout, plan_apart

SIZES: Mapping[str, tuple[int, ...]] = {
    "hectares": (1, 2, 5, 10, 20, 50, 100, 200, 500),
    "tractors": (1, 2, 5, 10, 20, 50, 100),
    "obstacles": (0, 10, 50, 100, 200),
}
TRACTORS_HA, OBSTACLES_HA = 50.0, 20.0
WIDTH_M, SPEED_KMH, RADIUS_M = 6.0, 10.0, 5.5
FIELD_SIDES = ((0.0, 0.0), (1.1, 0.04), (1.06, 0.97), (0.03, 0.93))  # no two of them parallel
POINT_KINDS: Mapping[str, int] = {"pole": 60, "trees": 40}
"""Percent of the obstacles of each kind; neither grows with the field."""
SEED = 45
COSTS: Mapping[str, tuple[str, int]] = {"cpu_s": ("CPU s", 1), "peak_mb": ("MB", 0)}


def build_outline(hectares: float) -> shapely.Polygon:
    """A field of so many hectares, nearly square."""
    plain = shapely.Polygon(FIELD_SIDES)
    scale = math.sqrt(1e4 * hectares / plain.area)
    return shapely.Polygon([(scale * x, scale * y) for x, y in FIELD_SIDES])


@cache
def draw_points(count: int) -> tuple[Obstacle, ...]:
    """So many obstacles on the field of OBSTACLES_HA; the first of more are the same."""
    return tuple(draw_obstacles(random.Random(SEED), build_outline(OBSTACLES_HA), count, POINT_KINDS))


def build_sized_job(what: str, size: int, tractors: Sequence[int]) -> Job:
    """The job of one size of SIZES."""
    hectares = {"hectares": float(size), "tractors": TRACTORS_HA, "obstacles": OBSTACLES_HA}[what]
    return build_job(
        f"{size} {what}",
        build_outline(hectares),
        draw_points(size) if what == "obstacles" else (),
        width_m=WIDTH_M,
        speed_kmh=SPEED_KMH,
        radius_m=RADIUS_M,
        tractors=(size,) if what == "tractors" else tractors,
    )


def fit_exponent(costs_by_size: Mapping[int, float]) -> float | None:
    """The slope of log cost by log size over the upper half of the sizes over 0; None with fewer than two of them."""
    sizes = sorted(size for size in costs_by_size if size > 0)
    upper = sizes[len(sizes) // 2 :]
    if len(upper) < 2:
        return None
    costs = [costs_by_size[size] for size in upper]
    return float(np.polyfit(np.log(upper), np.log(costs), 1)[0])


def measure_growth(what: str, most: int, tractors: Sequence[int], checkouts: Sequence[Path]) -> Iterator[list[str]]:
    """Of one row of sizes: a line per size, one size after another, then the exponents of every checkout."""
    costs: dict[tuple[Path, str], dict[int, float]] = {(one, key): {} for one in checkouts for key in COSTS}
    trying = list(checkouts)
    for size in [size for size in SIZES[what] if size <= most] if most > 0 else []:
        cells = []
        for checkout in checkouts:
            if checkout not in trying:
                cells.append("not tried")
                continue
            answer = plan_apart(build_sized_job(what, size, tractors), checkout)
            cells.append(format_answer(answer))
            if is_planned(answer):
                for key in COSTS:
                    costs[checkout, key][size] = answer[key]
            elif answer["crash"] is not None:
                trying.remove(checkout)
        yield [f"{size} {what}", *cells]
    for key, (unit, _) in COSTS.items():
        found = (fit_exponent(costs[checkout, key]) for checkout in checkouts)
        yield [f"  exponent, {unit}", *("-" if one is None else f"{one:.2f}" for one in found)]


def format_answer(answer: Answer) -> str:
    """CPU and memory of a plan, or why there is none."""
    if not is_planned(answer):
        return str(answer["refused"] or answer["crash"])[:60]
    cells = (f"{answer[key]:8.{digits}f} {unit}" for key, (unit, digits) in COSTS.items())
    return f"{' '.join(cells)} {answer['worked_pct']:6.2f} % by {answer['tractors']}"


def parse_options() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for what, sizes in SIZES.items():
        name = "ha" if what == "hectares" else what
        parser.add_argument(f"--most-{name}", dest=what, type=int, default=sizes[-1], help=f"of {sizes}")
    parser.add_argument("--tractors", dest="counts", default="1-6", help="counts tried on every field, such as 1-6")
    parser.add_argument("--against", type=Path, help="another checkout, which plans the same")
    return parser.parse_args()


def main() -> None:
    """One row of sizes after another."""
    options = parse_options()
    checkouts = [ROOT, *([options.against] if options.against else [])]
    for checkout in checkouts:
        compile_checkout(checkout)
    print(f"{'':18} {'here':44} {'base' if options.against else ''}".rstrip())
    for what in SIZES:
        for name, *cells in measure_growth(what, getattr(options, what), parse_counts(options.counts), checkouts):
            print(f"{name:18} {' '.join(f'{cell:44}' for cell in cells)}".rstrip(), flush=True)
    print(f"A plan is ended after {LIMIT_S:.0f} s of CPU.")


if __name__ == "__main__":
    main()
