"""Layouts as chosen beside those of bearings named by hand: python -m tests.benchmarks.bearings FOLDER

Of the parcels in the GeoJSON files of FOLDER, `--parcels` evenly chosen ones between `--from-ha` and `--to-ha` are laid
out as `headland plan` does it, and once more with every bearing of a grid. One tractor works each layout, and the time
is told two ways: as the choice of the layout estimates it, and as simulated with the order searched and missed ground
worked at the same rate. Bearings whose estimate is far above the least are not simulated, and without `--driven` none
is. The ratio is that of the chosen layout to the best by hand: above 1.005 a bearing or a number of headland passes was
overlooked or misjudged. CPU is that of choosing, of the whole context, and of the context with a bearing given.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from fields.documents.reader import read_field
from fields.errors import FieldError
from fields.geometry.field import Field
from fields.layout.swaths import Layout
from fields.units import MPS_PER_KMH
from planner.errors import RequestError
from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.layout_choice import estimate_finish_s
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from reports.common.plan_results import get_finished_field_s
from strategies.path_planning.errors import StrategyError

WORTH_DRIVING = 1.05  # to the least estimate by hand: a higher one is not simulated
LIMIT = 1.005
STRATEGY = "row-by-row-optimised"


@dataclass
class LaidOut:
    """One layout of a parcel: the bearing named (None: chosen), seconds as estimated and as simulated, CPU seconds."""

    bearing_deg: float | None
    context: PlanningContext
    estimated_s: float
    cpu_s: float
    driven_s: float | None = None

    def drive(self) -> None:
        """Simulate it; `driven_s` stays None if the plan is not feasible."""
        result = simulate_candidate(self.context, Candidate(STRATEGY, 1)).result
        self.driven_s = get_finished_field_s(result) if result.feasible else None


def list_parcels(folder: Path, count: int, from_ha: float, to_ha: float) -> Iterator[tuple[str, Field]]:
    """Evenly chosen parcels of a size, by name."""
    names = []
    for path in sorted(folder.glob("*.geojson")):
        features = json.loads(path.read_text(encoding="utf-8")).get("features", [None])
        names += [str(path)] if len(features) == 1 else [f"{path}#{index}" for index in range(len(features))]
    fields = []
    for name in names:
        try:
            field = read_field(name)
        except ValueError:
            continue
        if from_ha <= field.area_ha <= to_ha:
            fields.append((f"{Path(name).name}", field))
    wanted = min(count, len(fields))
    yield from (fields[index * len(fields) // wanted] for index in range(wanted))


def lay_out(request: PlanRequest, field: Field, bearing_deg: float | None) -> LaidOut | None:
    """The layout of a request, or None if it has none."""
    begun = time.process_time()
    try:
        context = prepare_context(WorkOrder(replace(request, bearing_deg=bearing_deg), field))
    except (FieldError, RequestError, StrategyError):
        return None
    took = time.process_time() - begun
    return LaidOut(bearing_deg, context, estimate_finish_s(context), took)


def describe(layout: Layout) -> str:
    """Bearing, cells, headland passes and swaths."""
    return f"{layout.bearing_deg:5.1f} {len(layout.cells)}c {layout.headland_passes}p {len(layout.swaths):3d}s"


def compare(name: str, field: Field, request: PlanRequest, step_deg: float, driven: bool) -> tuple[float, float] | None:
    """Print the row of one parcel; the ratio (driven if both are) and the CPU of choosing."""
    chosen = lay_out(request, field, None)
    grid = [step_deg * k for k in range(round(180.0 / step_deg))]
    by_hand = [laid for bearing in grid if (laid := lay_out(request, field, bearing)) is not None]
    if chosen is None or not by_hand:
        print(f"{name:18s} {field.area_ha:5.2f} no layout")
        return None
    least = min(by_hand, key=lambda laid: laid.estimated_s)
    ratio = chosen.estimated_s / least.estimated_s
    told = ""
    if driven:
        for laid in (chosen, *by_hand):
            if laid is chosen or laid.estimated_s <= WORTH_DRIVING * least.estimated_s:
                laid.drive()
        feasible = [laid for laid in by_hand if laid.driven_s is not None]
        if chosen.driven_s is None or not feasible:
            told = f"  not feasible (chosen: {chosen.driven_s}, by hand: {len(feasible)})"
        else:
            best = min(feasible, key=lambda laid: laid.driven_s or 0.0)
            assert best.driven_s is not None
            ratio = chosen.driven_s / best.driven_s
            told = (
                f"{chosen.driven_s:8.0f} {best.driven_s:8.0f} {ratio:6.4f}  {best.bearing_deg:5.1f} "
                f"[{describe(best.context.layout)}] {chosen.estimated_s / chosen.driven_s:6.3f} "
                f"{best.estimated_s / best.driven_s:6.3f}"
            )
    cpu_s = chosen.cpu_s
    print(
        f"{name:18s} {field.area_ha:5.2f} [{describe(chosen.context.layout)}] {chosen.estimated_s:7.0f} "
        f"{least.estimated_s:7.0f} {chosen.estimated_s / least.estimated_s:6.4f}  {least.bearing_deg:5.1f} "
        f"{cpu_s:5.2f} {statistics.median(laid.cpu_s for laid in by_hand):5.2f} {told}",
        flush=True,
    )
    return ratio, cpu_s


def main() -> None:
    """Read, lay out, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--parcels", type=int, default=20)
    parser.add_argument("--only", default="", help="parcels whose names contain this")
    parser.add_argument("--from-ha", type=float, default=0.5)
    parser.add_argument("--to-ha", type=float, default=8.0)
    parser.add_argument("--step", type=float, default=7.5, help="of the grid, degrees")
    parser.add_argument("--width", type=float, default=3.0, help="working width, metres")
    parser.add_argument("--radius", type=float, help="turning radius, metres")
    parser.add_argument("--speed", type=float, default=5.0, help="working speed, km/h")
    parser.add_argument("--driven", action="store_true", help="simulate the layouts too")
    options = parser.parse_args()
    request = PlanRequest(
        width_m=options.width, speed_mps=options.speed * MPS_PER_KMH, radius_m=options.radius, tractors=(1,),
        strategies=(STRATEGY,),
    )  # fmt: skip
    parcels = list(list_parcels(options.folder, options.parcels, options.from_ha, options.to_ha))
    prepare_context(WorkOrder(request, parcels[0][1]))
    print("parcel                ha [chosen             ]  est. s  hand s  ratio   at     CPU given  driven s   hand s")
    rows = [
        row
        for name, field in parcels
        if options.only in name and (row := compare(name, field, request, options.step, options.driven))
    ]
    over = sum(ratio > LIMIT for ratio, _ in rows)
    print(
        f"{len(rows)} parcels: ratio median {statistics.median(ratio for ratio, _ in rows):.4f}, greatest "
        f"{max(ratio for ratio, _ in rows):.4f}, above {LIMIT}: {over}; CPU of choosing {sum(c for _, c in rows):.1f} s"
    )


if __name__ == "__main__":
    main()
