"""What diagnoses are worth on runs with no part in anything: python -m tests.benchmarks.unseen [--parts demo third]

A row per set: the distance error (cm) on unseen runs over 1, 5 and 20 s, by the tractor file as it was and by the model
that the diagnosis offers. `demo` hides each effect of the catalogue in logs of this simulator, `third` takes a case of
each kind of the third reference; both are driven again with other draws of ground, noise and places. `real` are the
logs of vehicles in `--logs FOLDER TRACTOR GROUND`, which may be given again; a quarter of the runs is held out. A set
takes 10 to 60 s of CPU. The exit status is 1 if a model that is offered for saving is worse on unseen runs at any
horizon, by more than the scatter of its pieces, which is how `--holdout` judges; 2 for logs that cannot be used.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from planner.pipeline.held_out_runs import AUTO, split_held_out_runs
from tests.diagnosis.foreign_sets import draw_cases, make_logs
from tests.truth.cases import KINDS, TruthCase
from vehicle.identification.diagnosis.demo_logs import draw_hidden_effect, simulate_demo_logs
from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.diagnosis.holdout import HARM_FACTOR, LEAST_HARM_CM, LEAST_HARM_DEG, measure_holdout
from vehicle.identification.diagnosis.results import ErrorsByHorizon, HoldoutResult
from vehicle.identification.errors import LogError
from vehicle.identification.logs.reader import build_log, read_logs
from vehicle.identification.logs.schema import Log
from vehicle.identification.replay.horizon_errors import HorizonError
from vehicle.model.effects import CATALOGUE
from vehicle.model.tractor import Tractor, load_tractor

SHOWN_S = (1.0, 5.0, 20.0)
UNSEEN_SEED, DEMO_RATE_HZ = 500_000, 10.0
PARTS = ("demo", "third", "real")


@dataclass(frozen=True, eq=False)
class LogSet:
    """Logs to diagnose, logs of the same vehicle that have no part in that, and the tractor file."""

    name: str
    logs: Sequence[Log]
    unseen_logs: Sequence[Log]
    tractor: Tractor
    ground: str


@dataclass(frozen=True, eq=False)
class UnseenRow:
    """A set, what was named, whether the model is offered for saving, and errors on its unseen runs."""

    name: str
    named: tuple[str, ...]
    is_offered: bool
    has_speed: bool
    holdout: HoldoutResult
    cpu_s: float

    @property
    def is_worse(self) -> bool:
        """Whether the model is offered although it raises an error on unseen runs, by more than that scatters."""
        is_helpful = self.holdout.helps or self.holdout.is_unchanged
        return (
            self.is_offered
            and not is_helpful
            and is_error_risen(self.holdout.before, self.holdout.after, self.has_speed)
        )


def is_error_risen(before: ErrorsByHorizon, after: ErrorsByHorizon, with_along: bool) -> bool:
    """Whether an error of any horizon and kind is noticeably larger; those along the path count `with_along`."""
    least = {"cross_cm": LEAST_HARM_CM, "heading_deg": LEAST_HARM_DEG}
    least |= {"along_cm": LEAST_HARM_CM} if with_along else {}
    return any(
        getattr(after[horizon], kind) - getattr(errors, kind) > size
        and getattr(after[horizon], kind) > HARM_FACTOR * max(getattr(errors, kind), size)
        for horizon, errors in before.items()
        for kind, size in least.items()
    )


def list_demo_sets(seed: int) -> Iterator[LogSet]:
    """Every effect that the demonstration can hide, and none."""
    tractor = load_tractor("eg105")
    for name in (None, *(effect.id for effect in CATALOGUE if not effect.is_of_log_alone)):
        hidden = None if name is None else draw_hidden_effect(seed, tractor, name)
        logs, unseen = (
            simulate_demo_logs(hidden, tractor, "soil", each, DEMO_RATE_HZ) for each in (seed, seed + UNSEEN_SEED)
        )
        yield LogSet(f"demo {name or 'nothing'}", logs, unseen, tractor, "soil")


def list_third_sets(seed: int) -> Iterator[LogSet]:
    """A case of each kind; what befalls single runs is not in the unseen ones."""
    tractor = load_tractor("eg105")
    for kind in KINDS:
        for case in draw_cases("third", seed, [kind])[:1]:
            laws = tuple(law for law in case.laws if law.kind != "by_run")
            unseen = replace(case, seed=case.seed + UNSEEN_SEED, faults=(), laws=laws)
            yield LogSet(f"third {kind} {_name_hidden(case)}", _make_third(case), _make_third(unseen), tractor, "soil")


def _name_hidden(case: TruthCase) -> str:
    laws = [f"{law.effect} {law.kind}" for law in case.laws]
    return "+".join([*case.effects, *case.columns, *laws, *(fault.id for fault in case.faults), *case.outside]) or "-"


def _make_third(case: TruthCase) -> list[Log]:
    return [build_log(frame, frame.attrs["name"]) for frame in make_logs("third", case)]


def list_real_sets(folders: Sequence[Sequence[str]]) -> Iterator[LogSet]:
    """The logs of vehicles, a quarter of them unseen."""
    for folder, file, ground in folders:
        tractor, paths = load_tractor(Path(file)), sorted(Path(folder).glob("*.csv"))
        if not paths:
            raise LogError(f"There is no log in {folder}; give a folder of CSV files in the columns of the guide.")
        split = split_held_out_runs(read_logs(paths, wheelbase_m=tractor.wheelbase_m), AUTO)
        yield LogSet(f"real {tractor.name}", split.used_logs, split.held_out_logs, tractor, ground)


def measure_set(one: LogSet) -> UnseenRow:
    """Diagnose the logs of a set and replay its unseen ones."""
    begun = time.process_time()
    found = diagnose_logs(one.logs, one.tractor, one.ground)
    holdout = measure_holdout(one.unseen_logs, one.tractor, found.tractor, one.ground)
    has_speed = all(log.speed_mps is not None for log in one.unseen_logs)
    return UnseenRow(one.name, found.named, found.is_savable, has_speed, holdout, time.process_time() - begun)


def format_row(row: UnseenRow) -> str:
    """Return the row of a table in Markdown."""
    cells = [
        f"{_compute_distance_cm(row.holdout.before[horizon], row.has_speed):.1f} -> "
        f"{_compute_distance_cm(row.holdout.after[horizon], row.has_speed):.1f}"
        if horizon in row.holdout.before
        else "-"
        for horizon in SHOWN_S
    ]
    verdict = "no" if not row.is_offered else "unchanged" if row.holdout.is_unchanged else "yes"
    verdict += ", WORSE" if row.is_worse else ""
    return f"| {' | '.join([row.name, ', '.join(row.named) or '-', *cells, verdict])} |"


def _compute_distance_cm(error: HorizonError, has_speed: bool) -> float:
    return math.hypot(error.cross_cm, error.along_cm) if has_speed else error.cross_cm


HEAD = (
    f"| set | named | {' | '.join(f'{horizon:g} s, cm' for horizon in SHOWN_S)} | offered |\n|---|---|---|---|---|---|"
)


def print_rows(sets: Iterator[LogSet]) -> list[UnseenRow]:
    """Print rows as they come and return them."""
    rows = []
    for one in sets:
        rows.append(measure_set(one))
        print(format_row(rows[-1]), flush=True)
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and print; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS, help="which sets")
    parser.add_argument("--seed", type=int, default=71, help="of the demo and of the third reference")
    parser.add_argument("--logs", nargs=3, action="append", default=[], metavar=("FOLDER", "TRACTOR", "GROUND"),
                        help="real logs: a folder of CSV files, the tractor file, the ground")  # fmt: skip
    chosen = parser.parse_args(arguments)
    if chosen.seed < 0:
        parser.error(f"--seed {chosen.seed} is negative; use 0 or more.")
    print(HEAD)
    rows = []
    try:
        if "demo" in chosen.parts:
            rows += print_rows(list_demo_sets(chosen.seed))
        if "third" in chosen.parts:
            rows += print_rows(list_third_sets(chosen.seed))
        if "real" in chosen.parts:
            rows += print_rows(list_real_sets(chosen.logs))
    except (LogError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    offered = [row for row in rows if row.is_offered and not row.holdout.is_unchanged]
    worse = [row.name for row in rows if row.is_worse]
    print(f"\n{len(rows)} sets, {sum(row.cpu_s for row in rows) / len(rows):.0f} s of CPU each; {len(offered)} models "
          f"offered that change the tractor, {len(worse)} of them worse: {', '.join(worse) or 'none'}.")  # fmt: skip
    return 1 if worse else 0


if __name__ == "__main__":
    sys.exit(main())
