"""Plan random jobs with default options, each in a process of its own, and print what the answers are worth.

    python -m tests.benchmarks.answers FOLDER [--jobs 100] [--first 1] [--tractors 1] [--out FILE] [--against CHECKOUT]
    python -m tests.benchmarks.answers FOLDER --only 45003,45010-dk-004
    python -m tests.benchmarks.answers --report FILE

Half of the jobs are on parcels of the field files in FOLDER (0.5 to 40 ha), half on made shapes (1 to 15 ha), half with
1 to 20 ponds, poles and groups of trees; each is drawn by its seed, `--first` and those that follow. `--tractors 1-3`
asks for up to 1, 2 or 3 tractors, `--tractors 1` for exactly one. A job that takes 900 s of CPU is ended and counted.
`--out` gets a line of JSON per job, and a run that was stopped goes on where it was; `--against` has another checkout
plan the same job right after, and the report tells its figures (base) as well. All cores plan a job; its CPU is that of
all processes together.
"""

import argparse
import json
import statistics
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from tests.benchmarks.drawn_jobs import choose_parcels, draw_job
from tests.benchmarks.machines import compute_quantiles
from tests.benchmarks.parcels import iter_parcels
from tests.benchmarks.planned_jobs import KMH, LIMIT_S, Answer, Job, build_field, compile_checkout, plan_apart

ROOT = Path(__file__).parents[2]
Row = dict[str, Any]
ENOUGH_PCT, SLOWER = 95.0, 1.05  # less is worked only with a remark; no job finishes later than this by the base


def draw_jobs(options: argparse.Namespace) -> list[Job]:
    """The jobs of the command line."""
    parcels = choose_parcels([*iter_parcels(options.folder)])
    if not parcels:
        raise SystemExit(f"There is no parcel of 0.5 to 40 ha in {options.folder}; name a folder with GeoJSON files.")
    names = [name for name in options.only.split(",") if name]
    seeds = [int(name.partition("-")[0]) for name in names] or range(options.first, options.first + options.jobs)
    return [draw_job(seed, parcels, exact=options.tractors == "1") for seed in seeds]


def describe_job(job: Job) -> Row:
    """What a row tells of a job, apart from its answers."""
    kept = {key: job[key] for key in ("name", "width_m", "speed_kmh", "radius_m", "tractors")}
    asked = {"asked": kept.pop("tractors"), "obstacles": len(job["obstacles"])}
    return kept | asked | {"ha": round(build_field(job).area_ha, 4)}


def read_rows(path: Path | None) -> dict[str, Row]:
    """The rows of a file by the names of their jobs, the last of each; none without a file."""
    if path is None or not path.exists():
        return {}
    rows = map(json.loads, path.read_text(encoding="utf-8").splitlines())
    return {row["name"]: row for row in rows}


def iter_rows(jobs: Sequence[Job], against: Path | None, out: Path | None) -> Iterator[Row]:
    """A row per job, from the file where it has been planned as it is asked now."""
    known = read_rows(out)
    for checkout in (ROOT, against):
        if checkout is not None:
            compile_checkout(checkout)
    for job in jobs:
        row = known.get(job["name"], {})
        asked = describe_job(job)
        if row and asked.items() <= row.items() and ("base" in row or against is None):
            yield row
            continue
        row = asked | plan_apart(job, ROOT)
        if against is not None:
            row["base"] = plan_apart(job, against)
        if out is not None:
            with out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
        yield row


def is_planned(answer: Answer) -> bool:
    """Whether an answer has a plan."""
    return answer["worked_pct"] is not None


def format_row(row: Row) -> str:
    """A line of the table, and one of the base."""
    head = f"{row['name']:22} {row['ha']:6.2f} {row['width_m']:4g} {row['speed_kmh']:4g} {row['radius_m']:4g} "
    lines = [f"{head}{max(row['asked']):2} {row['obstacles']:3} {_format_answer(row)}"]
    if "base" in row:
        lines.append(f"{'  base':52}{_format_answer(row['base'])}")
    return "\n".join(lines)


def _format_answer(answer: Answer) -> str:
    times = " ".join(f"{answer[key]:7.1f}" if answer[key] is not None else "      -" for key in ("wall_s", "cpu_s"))
    if not is_planned(answer):
        return f"{times} {answer['refused'] or answer['crash']}"[:140]
    return (
        f"{times} {answer['worked_pct']:6.2f} {answer['time_s']:7.0f} {answer['body_outside_m']:6.2f} "
        f"{answer['over_finished_m2'] or 0.0:6.0f} {answer['reversals']:4} {answer['tractors']} {answer['strategy']}"
    )


def compute_time_over(row: Row, answer: Answer) -> float:
    """The time of a plan as a multiple of its worked ground by width, speed and tractors."""
    worked_m2 = 1e4 * row["ha"] * answer["worked_pct"] / 100.0
    ideal_s = worked_m2 / (row["width_m"] * row["speed_kmh"] * KMH * answer["tractors"])
    return float(answer["time_s"] / ideal_s)


def find_tenth_worst(values: Sequence[float]) -> float:
    """The value that a tenth of all reach or exceed: of a hundred the tenth largest."""
    return sorted(values, reverse=True)[max(len(values) // 10, 1) - 1]


def summarise(rows: Sequence[Row], get_answer: Callable[[Row], Answer]) -> Iterator[str]:
    """The lines of the report on the answers of one checkout."""
    answers = [(row, get_answer(row)) for row in rows]
    planned = [(row, answer) for row, answer in answers if is_planned(answer)]
    refused = [(row, answer) for row, answer in answers if answer["refused"] is not None]
    lost = [(row, answer) for row, answer in answers if answer["crash"] is not None]
    slowest = f" (slowest after {max(answer['wall_s'] for _, answer in refused):.1f} s)" if refused else ""
    yield f"{len(rows)} jobs: {len(planned)} planned, {len(refused)} refused{slowest}, {len(lost)} lost"
    for row, answer in refused + lost:
        yield f"  {row['name']}: {answer['refused'] or answer['crash']}"
    yield from _summarise_costs([(row, answer) for row, answer in answers if answer["cpu_s"] is not None])
    if not planned:
        return
    median, tenth = compute_quantiles(answer["worked_pct"] for _, answer in planned)
    row, least = min(planned, key=lambda one: float(one[1]["worked_pct"]))
    yield f"worked: median {median:.2f} %, tenth {tenth:.2f} %, lowest {least['worked_pct']:.2f} % ({row['name']})"
    silent = [row["name"] for row, one in planned if one["worked_pct"] < ENOUGH_PCT and not one["remark"]]
    yield f"worked below {ENOUGH_PCT:g} % without a remark: {len(silent)} {' '.join(silent)}".rstrip()
    over = [compute_time_over(row, answer) for row, answer in planned]
    yield f"time over: median {statistics.median(over):.3f}, tenth worst {find_tenth_worst(over):.3f}"
    yield _summarise_worst("outside, any body, m", planned, "body_outside_m", 2)
    yield f"over finished ground: {_sum_over_finished_m2([answer for _, answer in planned]):.0f} m2 in all"


def _summarise_costs(answers: Sequence[tuple[Row, Answer]]) -> Iterator[str]:
    if answers:
        yield _summarise_worst("CPU s", answers, "cpu_s", 1)
        yield _summarise_worst("wall s", answers, "wall_s", 1)
    measured = [one for one in answers if one[1]["peak_mb"] is not None]
    if measured:
        yield _summarise_worst("memory of a process, MB", measured, "peak_mb", 0)


def _summarise_worst(name: str, answers: Sequence[tuple[Row, Answer]], key: str, digits: int) -> str:
    row, worst = max(answers, key=lambda one: float(one[1][key]))
    median = statistics.median(answer[key] for _, answer in answers)
    return f"{name}: median {median:.{digits}f}, worst {worst[key]:.{digits}f} ({row['name']})"


def compare_with_base(rows: Sequence[Row]) -> Iterator[str]:
    """The lines on jobs that both checkouts planned, and on those that one of them did."""
    compared = [row for row in rows if "base" in row]
    for label, here in (("planned here only", True), ("planned by the base only", False)):
        names = [row["name"] for row in compared if is_planned(row) is here and is_planned(row["base"]) is not here]
        yield f"{label}: {len(names)} {' '.join(names)}".rstrip()
    both = [row for row in compared if is_planned(row) and is_planned(row["base"])]
    if both:
        later = _list_ratios(both, lambda answer: float(answer["time_s"] / answer["worked_pct"]))
        slower = sum(ratio > SLOWER for ratio, _ in later)
        yield f"{_format_ratios('finish for equal ground', later)}; more than 5 % later: {slower}"
        own_m2, base_m2 = _sum_over_finished_m2(both), _sum_over_finished_m2([row["base"] for row in both])
        yield f"over finished ground, planned by both: {own_m2:.0f} m2, base {base_m2:.0f}"
    timed = [row for row in compared if row["cpu_s"] and row["base"]["cpu_s"]]
    if timed:
        yield _format_ratios("CPU s", _list_ratios(timed, lambda answer: float(answer["cpu_s"])))
        yield _format_ratios("wall s", _list_ratios(timed, lambda answer: float(answer["wall_s"])))


def _sum_over_finished_m2(answers: Sequence[Answer]) -> float:
    return sum(float(answer["over_finished_m2"] or 0.0) for answer in answers)


def _list_ratios(rows: Sequence[Row], measure: Callable[[Answer], float]) -> list[tuple[float, str]]:
    return sorted((measure(row) / measure(row["base"]), row["name"]) for row in rows)


def _format_ratios(name: str, ratios: Sequence[tuple[float, str]]) -> str:
    median, (worst, job) = statistics.median(ratio for ratio, _ in ratios), ratios[-1]
    return f"{name} against base: median {median:.3f}, worst {worst:.3f} ({job})"


def report(rows: Sequence[Row]) -> Iterator[str]:
    """The whole report."""
    yield from summarise(rows, lambda row: row)
    compared = [row for row in rows if "base" in row]
    if compared:
        yield "base:"
        yield from (f"  {line}" for line in summarise(compared, lambda row: row["base"]))
        yield from compare_with_base(compared)


def parse_options() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--jobs", type=int, default=100)
    parser.add_argument("--first", type=int, default=1, help="seed of the first job")
    parser.add_argument("--tractors", choices=("1", "1-3"), default="1-3")
    parser.add_argument("--out", type=Path, help="lines of JSON, a row per job; the run goes on from what it holds")
    parser.add_argument("--against", type=Path, help="another checkout, which plans the same jobs")
    parser.add_argument("--only", default="", help="some jobs, by their seeds or names")
    parser.add_argument("--report", type=Path, help="print the report of such a file, and plan nothing")
    options = parser.parse_args()
    if options.folder is None and options.report is None:
        parser.error("give a folder with field files, or --report FILE")
    return options


def main() -> None:
    """One job after another, then the report."""
    options = parse_options()
    if options.report is not None:
        rows = list(read_rows(options.report).values())
    else:
        jobs, rows = draw_jobs(options), []
        print(f"{'job':22} {'ha':>6} {'m':>4} km/h rad. up obs  wall s   CPU s worked  time s outs. finish. rev.")
        for row in iter_rows(jobs, options.against, options.out):
            rows.append(row)
            print(format_row(row), flush=True)
        print(f"A job is ended after {LIMIT_S:.0f} s of CPU.")
    print("\n".join(report(rows)))


if __name__ == "__main__":
    main()
