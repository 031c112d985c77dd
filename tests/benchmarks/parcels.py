"""Plan every parcel of the GeoJSON files given, or big drawn fields, and print CPU seconds against hectares and tracks.

    python -m tests.benchmarks.parcels file.geojson [...] [--tractors 1,2,3] [--every 5] [--from-ha 1 --to-ha 10]
    python -m tests.benchmarks.parcels --big 24,60,200 --tractors 1-5 --width 12

Everything is compiled before the clock starts. A row says where the seconds go: field and layout, search of the order,
paths between tracks, right of way, simulation, measuring, the rest. A plan counts as feasible or as refused with a
reason; anything else is a fault. `--reasons` prints why plans are not feasible. The last lines sum up.
"""

from __future__ import annotations

import argparse
import json
import resource
import statistics
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fields.documents.reader import read_field
from fields.geometry.field import Field
from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate, simulate_candidates
from planner.evaluation.candidates.pruning import prunes_candidates
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.ranking import list_candidates
from planner.request.option_texts import parse_counts
from planner.request.plan_request import PlanRequest
from reports.common.plan_results import PlanResult, get_finished_field_s
from tests.benchmarks.drawn import BIG, big_field
from tests.benchmarks.ledger import PARTS, Ledger, open_ledger


@dataclass
class Row:
    """What came of one field."""

    name: str
    area_ha: float = 0.0
    tracks: int = 0
    plans: list[PlanResult] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)
    refused: str = ""

    @property
    def cpu_s(self) -> float:
        """CPU seconds of all its plans."""
        return sum(self.seconds.values())

    @property
    def quickest(self) -> PlanResult | None:
        """The feasible plan that finishes the field first."""
        return next(iter(self.driven), None)

    @property
    def driven(self) -> list[PlanResult]:
        """Its feasible plans, the quickest to finish first."""
        return sorted((plan for plan in self.plans if plan.feasible), key=get_finished_field_s)


def parcels(path: Path) -> list[str]:
    """Names by which the polygons of a file can be read one by one."""
    data = json.loads(path.read_text(encoding="utf-8"))
    count = len(data["features"]) if data.get("type") == "FeatureCollection" else 1
    return [f"{path}#{index}" for index in range(count)] if count > 1 else [str(path)]


def chosen(options: argparse.Namespace) -> Iterator[tuple[str, Field | None, str]]:
    """Name, field and refusal of every requested field."""
    for name in options.big.split(",") if options.big else []:
        yield f"drawn-{name}", big_field(name), ""
    names = [where for path in options.files for where in parcels(path)]
    for where in names[:: options.every]:
        try:
            found = read_field(where)
        except ValueError as refusal:
            yield Path(where).name, None, str(refusal)
            continue
        if options.from_ha <= found.area_ha <= options.to_ha:
            yield Path(where).name, found, ""


def work(name: str, where: Field, scenario: PlanRequest) -> Row:
    """All plans of one field."""
    row = Row(name, where.area_ha)
    with open_ledger() as ledger:
        try:
            _plans(row, where, scenario, ledger)
        except ValueError as refusal:
            row.refused = f"{type(refusal).__name__}: {refusal}"
        except Exception as fault:
            row.refused = f"FAULT {type(fault).__name__}: {fault}"
        assert ledger.total_s >= 0.0
        row.seconds = ledger.seconds
    return row


def _plans(row: Row, where: Field, scenario: PlanRequest, ledger: Ledger) -> None:
    with ledger.book_part("layout"):
        site = prepare_context(WorkOrder(scenario, where))
    row.tracks = len(site.layout.swaths)
    todo = list_candidates(scenario)
    for count in scenario.tractors:
        alike = [one for one in todo if one.tractors == count]
        for _, evaluation in simulate_candidates(site, alike, prunes_candidates(site)):
            row.plans.append(evaluation.result)


def print_row(row: Row, counts: tuple[int, ...]) -> None:
    """One line: field, hectares, tracks, CPU seconds and their parts, feasible plans, best time per count."""
    best = []
    for count in counts[:6]:
        times = [get_finished_field_s(plan) for plan in row.driven if plan.tractors == count]
        best.append(f"{min(times):6.0f}" if times else "     -")
    parts = " ".join(f"{row.seconds.get(part, 0.0):7.2f}" for part in PARTS)
    worked = f"{row.driven[0].worked_pct:5.1f}" if row.driven else "    -"
    print(
        f"{row.name:20} {row.area_ha:6.2f} {row.tracks:5} {row.cpu_s:8.2f} {parts}  "
        f"{len(row.driven):3}/{len(row.plans):<3} {worked} {' '.join(best)} {row.refused[:120]}",
        flush=True,
    )


def print_reasons(row: Row) -> None:
    """Why plans of a field are not feasible."""
    for plan in row.plans:
        if not plan.feasible:
            print(f"      {plan.tractors} {plan.strategy}: {(plan.reason or '')[:140]}")


def summary(rows: list[Row]) -> None:
    """Median and worst seconds, feasible and worked shares, reasons counted."""
    planned = [row for row in rows if row.plans]
    if planned:
        times = sorted(row.cpu_s for row in planned)
        served = sum(bool(row.driven) for row in planned)
        print(f"CPU s: median {statistics.median(times):.2f}, worst {times[-1]:.2f}; {served} of {len(rows)} feasible")
        total = sum(times)
        shares = ((part, sum(row.seconds[part] for row in planned) / total) for part in PARTS)
        print("where: " + ", ".join(f"{part} {100 * share:.0f} %" for part, share in shares))
        worked = sorted(row.driven[0].worked_pct or 0.0 if row.driven else 0.0 for row in planned)
        tenth = worked[len(worked) // 10]
        print(f"worked by the quickest: median {statistics.median(worked):.1f} %, a tenth below {tenth:.1f} %")
    print("\n".join(count_reasons(rows)))
    faults = sum(row.refused.startswith("FAULT") for row in rows)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(f"faults: {faults}; refused whole: {sum(bool(row.refused) for row in rows)}; memory {memory:.0f} MB at most")


def count_reasons(rows: Sequence[Row]) -> Iterator[str]:
    """How many plans are feasible, and the most frequent reasons of the others."""
    plans = [plan for row in rows for plan in row.plans]
    yield f"plans: {sum(plan.feasible for plan in plans)} of {len(plans)} feasible"
    reasons = Counter(strip_numbers(plan.reason or "no reason") for plan in plans if not plan.feasible)
    yield from (f"  {count:4} {reason}" for reason, count in reasons.most_common(12))


def strip_numbers(reason: str) -> str:
    """A sentence without the words that hold numbers, so that like ones can be counted."""
    return " ".join(word for word in reason.split() if not any(letter.isdigit() for letter in word))[:100]


def add_options(parser: argparse.ArgumentParser, from_ha: float, to_ha: float) -> None:
    """The options by which parcels are chosen, and how they are planned."""
    parser.add_argument("--every", type=int, default=1, help="take every so many-th parcel")
    parser.add_argument("--tractors", default="1,2,3")
    parser.add_argument("--width", type=float, default=3.0)
    parser.add_argument("--from-ha", type=float, default=from_ha)
    parser.add_argument("--to-ha", type=float, default=to_ha)
    parser.add_argument("--reasons", action="store_true", help="say why plans are not feasible")


def parsed() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--big", default="", help=f"drawn fields: some of {','.join(BIG)}")
    add_options(parser, 0.0, 1e9)
    parser.add_argument("--strategies", default="", help="some of them only")
    group = parser.add_mutually_exclusive_group()
    group.add_argument("--headland", dest="no_headland", action="store_false", default=False, help="headlands worked")
    group.add_argument("--no-headland", dest="no_headland", action="store_true", help="headlands unworked")
    return parser.parse_args()


def main() -> None:
    """Run the sweep in this process, a field after another."""
    options = parsed()
    if not options.files and not options.big:
        options.big = "24"
    counts = parse_counts(options.tractors)
    more = {"strategies": tuple(options.strategies.split(","))} if options.strategies else {}
    scenario = PlanRequest(width_m=options.width, tractors=counts, no_headland=options.no_headland, **more)
    warm = prepare_context(WorkOrder(PlanRequest(field="iwamizawa", no_headland=options.no_headland)))
    for name in ("split-field", "row-by-row-optimised"):
        simulate_candidate(warm, Candidate(name, 2))
    heads = " ".join(f"{part[:7]:>7}" for part in PARTS)
    print(f"{'field':20} {'ha':>6} lines    CPU s {heads}  feasible worked  quickest s per count")
    rows = []
    for name, where, refusal in chosen(options):
        rows.append(Row(name, refused=refusal) if where is None else work(name, where, scenario))
        print_row(rows[-1], counts)
        if options.reasons:
            print_reasons(rows[-1])
    summary(rows)


if __name__ == "__main__":
    main()
