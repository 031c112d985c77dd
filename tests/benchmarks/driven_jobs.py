"""Figures of imported time logs beside a table of the same that was made another way.

    python -m tests.benchmarks.driven_jobs FOLDER TABLE

FOLDER holds ISO 11783-10 task data with time logs. TABLE is a text file with lines of the form
`| 01 | ha | min | stops min | v work m/s | active km | inactive km | lifts | fuel l | ...` among others. Printed are
ours, theirs in brackets where they differ, and how far counters and positions are apart, east-west stretched by what
the outline's area is short of the one its file says.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely

from planner.task_logs.log_import import import_runs, read_task_logs
from planner.task_logs.runs.phases import LoggedTurn, classify_phases, summarise_run
from planner.task_logs.runs.run_records import Array, ProjectedRun, project_run
from reports.task_logs.run_results import RunFigures

NAMES = ("ha", "min", "stops min", "m/s", "active km", "inactive km", "lifts", "fuel l")
DECIMALS = (2, 1, 1, 2, 2, 2, 0, 0)
_ROW = re.compile(r"^\|\s*(\d\d)\s*\|(.*)\|\s*$", re.MULTILINE)
_NUMBER = re.compile(r"\d+(\.\d+)?")


def theirs(table: Path) -> dict[str, list[float]]:
    """Rows of the table by the last two digits of the log."""
    rows = {}
    for match in _ROW.finditer(table.read_text(encoding="utf-8")):
        cells = [cell.strip().split(" ")[0] for cell in match[2].split("|")]
        if len(cells) >= len(NAMES) and all(_NUMBER.fullmatch(cell) for cell in cells[: len(NAMES)]):
            rows[match[1]] = [float(cell) for cell in cells[: len(NAMES)]]
    return rows


def ours(run: ProjectedRun, what: RunFigures) -> list[float]:
    """The same figures of one run."""
    return [
        (run.outline_m2 or 0.0) / 1e4, what.seconds / 60, what.stops_s / 60, what.working_mps or 0.0,
        (what.active_m or 0.0) / 1e3, (what.inactive_m or 0.0) / 1e3, float(what.lifts or 0), what.fuel_l or 0.0,
    ]  # fmt: skip


def scale_run_east_west(run: ProjectedRun, factor: float) -> ProjectedRun:
    """The run with its east-west extent scaled about the middle of its field, to undo anonymised positions."""
    if run.outline is None:
        return run
    middle = np.array(run.outline.centroid.coords[0])

    def scale_points(points: Array) -> Array:
        return np.asarray(middle + (points - middle) * (factor, 1.0))

    return replace(run, xy=scale_points(run.xy), outline=shapely.transform(run.outline, scale_points))


def lines(runs: list[ProjectedRun], table: dict[str, list[float]]) -> Iterator[str]:
    """A line per run, and the largest differences."""
    yield "log  " + "".join(f"{name:>18s}" for name in NAMES) + "   counters against positions, %"
    off, apart = [], []
    for run in runs:
        what = summarise_run(run)
        mine, other = ours(run, what), table.get(run.name[-2:])
        factor = 1.0 if run.outline is None or not run.outline_m2 else run.outline_m2 / run.outline.area
        placed = summarise_run(scale_run_east_west(run, factor)).placed_m
        share = 100.0 * (placed / what.counted_m - 1.0) if what.counted_m else float("nan")
        apart.append(share)
        cells = []
        for place, value in enumerate(mine):
            text = f"{value:.{DECIMALS[place]}f}"
            if other is not None:
                their = f"{other[place]:.{DECIMALS[place]}f}"
                text += f" ({their})" if text != their else ""
            cells.append(f"{text:>18s}")
        if other is not None:
            off.append([abs(a - b) for a, b in zip(mine, other, strict=True)])
        yield f"{run.name[-2:]:5s}" + "".join(cells) + f"{share:8.1f}"
    yield "most " + "".join(f"{value:18.3f}" for value in np.max(off, axis=0))
    near = sum(abs(one) <= 3.0 for one in apart)
    yield f"{near} of {len(apart)} runs within 3 %; the furthest {max(map(abs, apart)):.1f} %"


def turn_lines(turns: list[LoggedTurn], width_m: float) -> Iterator[str]:
    """Turns back without a stop, by how many tracks they lead over."""
    for over in (1, 2, 3):
        found = [one for one in turns if (over - 0.5) * width_m < one.offset_m <= (over + 0.5) * width_m]
        if found:
            seconds = np.array([one.seconds for one in found])
            yield (
                f"over {over}: n {len(found)}, median {np.median(seconds):.1f} s, mean {seconds.mean():.1f}, sd "
                f"{seconds.std(ddof=1):.1f}, length {np.median([one.length_m for one in found]):.0f} m"
            )


def main() -> None:
    """Read, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("table", type=Path)
    options = parser.parse_args()
    runs = [project_run(run) for run in read_task_logs(str(options.folder)).runs]
    print("\n".join(lines(runs, theirs(options.table))))
    turns = [turn for run in runs for turn in classify_phases(run).turns if turn.is_u_turn]
    print(f"turns of 180 +- 30 degrees without a stop: {len(turns)}")
    print("\n".join(turn_lines(turns, runs[0].width_m or 3.0)))
    print(f"rows {sum(len(run.time_s) for run in runs)} in {len(import_runs([str(options.folder)]).runs)} runs")


if __name__ == "__main__":
    main()
