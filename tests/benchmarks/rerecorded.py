"""Whether names flip when the same drives are written down another way:

python -m tests.benchmarks.rerecorded --out FILE [--reference third --first 7000 --kinds effect --most 10]

Sets of logs of a reference, or the demo logs with a drawn effect (`--reference demo`), are diagnosed as they are and at
10, 5 and 2 Hz, with steering columns held or interpolated for one to two seconds, and with times that jitter by 35 ms.
Answers go to FILE, a line of JSON each; called again with it, the tool does what is left. Answers of another state of
the code are not counted. A set takes one to two minutes of CPU. Printed are a row per set and variation, and sums per
variation: flips (another name, a name refuted, a value beyond both intervals) and losses (a name less sure or gone).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from tests.benchmarks.diagnosis import done_in
from tests.benchmarks.foreign_diagnosis import digest_code, read_last
from tests.diagnosis.foreign_sets import (
    REFERENCES,
    Record,
    describe_diagnosis,
    diagnose_frames,
    draw_cases,
    load_case_tractor,
    make_logs,
    name_case,
)
from tests.diagnosis.rerecording import VARIATIONS, is_as_recorded, list_flips, list_losses, vary_logs
from tests.truth.cases import KINDS, TruthCase
from vehicle.identification.diagnosis.demo_logs import HiddenEffect, draw_hidden_effect, simulate_demo_logs
from vehicle.model.tractor import Tractor, load_tractor

RECORDED, DEMO, DEMO_HZ = "as recorded", "demo", 20.0
Recording = tuple[str, list[pd.DataFrame], Tractor, list[str]]


def iter_recordings(arguments: argparse.Namespace) -> Iterator[Recording]:
    """Sets that are asked for: key, tables, the tractor file, and what may rightly be named."""
    for seed in range(arguments.first, arguments.first + arguments.seeds):
        if arguments.reference == DEMO:
            tractor = load_tractor("eg105")
            hidden = draw_hidden_effect(seed, tractor)
            key = f"demo {hidden.id} {DEMO_HZ:g} Hz {seed}"
            if arguments.only in key:
                yield key, make_demo_frames(hidden, tractor, seed), tractor, [hidden.id]
            continue
        for case in choose_cases(arguments, seed):
            tractor = load_case_tractor(arguments.reference, case)
            yield (
                name_case(arguments.reference, case),
                make_logs(arguments.reference, case),
                tractor,
                sorted(case.allowed),
            )


def choose_cases(arguments: argparse.Namespace, seed: int) -> list[TruthCase]:
    """The first cases of a seed in a drawn order."""
    cases = draw_cases(arguments.reference, seed, arguments.kinds)
    mixed = [cases[place] for place in np.random.default_rng([seed, 23]).permutation(len(cases))]
    return [case for case in mixed if arguments.only in name_case(arguments.reference, case)][: arguments.most]


def make_demo_frames(hidden: HiddenEffect | None, tractor: Tractor, seed: int) -> list[pd.DataFrame]:
    """The demo logs as tables."""
    frames = []
    for log in simulate_demo_logs(hidden, tractor, "soil", seed, rate_hz=DEMO_HZ):
        columns = ("time_s", "easting_m", "northing_m", "heading_deg", "speed_mps", "speed_command_mps",
                   "steering_command_deg", "steering_deg", "implement")  # fmt: skip
        frame = pd.DataFrame({name: getattr(log, name) for name in columns})
        frame.attrs["name"] = log.name
        frames.append(frame)
    return frames


def answer(frames: Sequence[pd.DataFrame], tractor: Tractor) -> Record:
    """What is said of a set; `error` in the place of an answer that never came."""
    try:
        said = describe_diagnosis(diagnose_frames(frames, tractor))
    except Exception as error:  # a set that breaks the diagnosis is a result, and must not end a run of hours
        return {"error": f"{type(error).__name__}: {error}", "named": [], "said": []}
    return {key: said[key] for key in ("named", "said", "unexplained", "headline")}


def run_recordings(arguments: argparse.Namespace, state: str) -> None:
    """Diagnose what is left and add the answers to the file."""
    known = {record["key"] for record in done_in(arguments.out, state)}
    with arguments.out.open("a", encoding="utf-8") as file:
        for key, frames, tractor, allowed in iter_recordings(arguments):
            for how in (RECORDED, *arguments.how):
                full = f"{key} | {how}"
                if full in known or (how != RECORDED and is_as_recorded(frames, how)):
                    continue
                record = answer(frames if how == RECORDED else vary_logs(frames, how), tractor)
                record |= {"key": full, "set": key, "how": how, "allowed": allowed, "state": state}
                file.write(json.dumps(record) + "\n")
                file.flush()
                print(f"{full:100s} {', '.join(record['named']) or record.get('error', 'no name')}", flush=True)


def print_table(records: Sequence[Record]) -> None:
    """Print a row per set and variation, and the sums per variation."""
    bases = {record["set"]: record for record in records if record["how"] == RECORDED}
    sums = {how: [0, 0, 0, 0] for how in VARIATIONS}
    print(f"\n{'set':72s} {'variation':13s} {'flips':>5s} {'losses':>6s}")
    for record in records:
        base = bases.get(record["set"])
        if record["how"] == RECORDED or base is None:
            continue
        flips, losses = list_flips(base, record), list_losses(base, record)
        sums[record["how"]] = [
            old + more for old, more in zip(sums[record["how"]], (1, bool(flips), len(flips), len(losses)), strict=True)
        ]
        print(f"{record['set']:72s} {record['how']:13s} {len(flips):5d} {len(losses):6d}  "
              f"{'; '.join([*(f'FLIP {one}' for one in flips), *losses])}")  # fmt: skip
    print(f"\n{'variation':13s} {'sets':>5s} {'with flips':>10s} {'flips':>6s} {'losses':>6s}")
    for how, (sets, flipping, flips, losses) in sums.items():
        print(f"{how:13s} {sets:5d} {flipping:10d} {flips:6d} {losses:6d}")
    print(f"{'all':13s} " + " ".join(
        f"{sum(row[place] for row in sums.values()):{width}d}" for place, width in enumerate((5, 10, 6, 6))
    ))  # fmt: skip


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--reference", choices=[*sorted(REFERENCES), DEMO], default="third", help="which truth")
    parser.add_argument("--first", type=int, default=7000, help="first seed")
    parser.add_argument("--seeds", type=int, default=1, help="how many seeds")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=None, help="only these kinds of cases")
    parser.add_argument("--only", default="", help="only sets with this in their key")
    parser.add_argument("--most", type=int, default=None, help="stop after so many cases of each seed")
    parser.add_argument("--how", nargs="+", choices=VARIATIONS, default=VARIATIONS, help="only these variations")
    parser.add_argument("--out", type=Path, required=True, help="file of the answers; added to, never overwritten")
    parser.add_argument("--report", action="store_true", help="only print what the file has, of any state of the code")
    arguments = parser.parse_args()
    if arguments.seeds < 1 or arguments.first < 0 or (arguments.most is not None and arguments.most < 1):
        parser.error("--seeds and --most are whole numbers from 1 on, --first from 0 on.")
    state = digest_code()
    if not arguments.report:
        run_recordings(arguments, state)
    print_table(read_last(arguments.out) if arguments.report else done_in(arguments.out, state))


if __name__ == "__main__":
    main()
