"""How often a diagnosis is right: python -m tests.benchmarks.diagnosis --first 100 --seeds 10 --share 2/5 --out FILE

Every set of tests.diagnosis.sets (80 a seed) is diagnosed; the answers go to FILE, a line of JSON each. Called again
with the same FILE it does what is left, so it can be stopped at any time. Answers of another state of the code are
neither counted nor taken for done. A set takes 1 to 9 s of CPU, a seed about 4 minutes of one core. With --share 2/5
a seed has 32 of its sets, others from seed to seed, each kind as often as every other in any five seeds in a row, and
on both tractors in any ten. Printed are what is asked of a diagnosis beside what it reached, a line per effect, and
every set that went wrong, by the key that --only repeats.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from fractions import Fraction
from pathlib import Path

import vehicle
from tests.diagnosis.sets import LogSet, record_of, sets_of
from tests.diagnosis.tally import Record, coverage_by_parameter, faults, table, tallied, verdicts
from tests.truth.effects import CLEAR_SIZES


def state_of_code() -> str:
    """A digest of all that decides an answer: the sources of the room that diagnoses, and of the truth."""
    digest = hashlib.sha256()
    here = Path(__file__).parents[1]
    files = [
        *Path(str(vehicle.__file__)).parent.rglob("*"),
        *(here / "truth").glob("*.py"),
        here / "diagnosis" / "sets.py",
    ]
    for file in sorted(file for file in files if file.suffix in (".py", ".toml", ".csv")):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def share_of(text: str) -> Fraction:
    """A share as --share has it, such as 2/5.

    Raises argparse.ArgumentTypeError beyond 0 to 1, and for an even number below the line: tractors take turns from
    seed to seed, and a set that is met every second seed would be met on one of them only.
    """
    rule = f"--share is {text!r}: give a part of the sets above 0 and up to 1, such as 2/5, odd below the line."
    try:
        share = Fraction(text)
    except (ValueError, ZeroDivisionError):
        raise argparse.ArgumentTypeError(rule) from None
    if not 0 < share <= 1 or share.denominator % 2 == 0:
        raise argparse.ArgumentTypeError(rule)
    return share


def in_share(one: LogSet, share: Fraction) -> bool:
    """Whether a set has its turn in its seed: in as many seeds of a round as the share has above the line."""
    above, below = share.numerator, share.denominator
    return (one.number + one.seed) * above % below < above


def done_in(out: Path, state: str) -> list[Record]:
    """The answers in a file that belong to this state of the code; a line cut off by a stop is passed over."""
    records: dict[str, Record] = {}
    for line in out.read_text(encoding="utf-8").splitlines() if out.exists() else ():
        try:
            record = json.loads(line)
        except json.JSONDecodeError:
            continue
        if record["state"] == state:
            records[record["key"]] = record
    return list(records.values())


def answers(sets: Iterable[LogSet], jobs: int) -> Iterator[Record]:
    """Answers as they come, from so many processes at once."""
    if jobs == 1:
        yield from map(record_of, sets)
        return
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as pool:
        for future in as_completed([pool.submit(record_of, one) for one in sets]):
            yield future.result()


def run(sets: list[LogSet], jobs: int, out: Path, state: str) -> None:
    """Diagnose what is left of the sets and add the answers to the file."""
    known = {record["key"] for record in done_in(out, state)}
    left = [one for one in sets if one.key not in known]
    cut_off = out.exists() and not out.read_bytes().endswith(b"\n") and out.stat().st_size
    with out.open("a", encoding="utf-8") as file:
        file.write("\n" if cut_off else "")
        for number, record in enumerate(answers(left, jobs), len(sets) - len(left) + 1):
            file.write(json.dumps({**record, "state": state}) + "\n")
            file.flush()
            said = ", ".join(record.get("named", ())) or record.get("error", "no name")
            print(f"{number:5d} of {len(sets)}  {record['key']:60s} {said}", flush=True)


def report(records: list[Record], share: Fraction, wanted: int) -> None:
    """Print the figures, and of how many sets they are."""
    tallies = tallied(records, list(CLEAR_SIZES))
    seeds, cpu_s = {record["seed"] for record in records}, sum(record.get("cpu_s", 0.0) for record in records)
    part = "every set" if share == 1 else f"{share} of the sets in turn"
    print(
        f"\n{len(records)} sets of {len(seeds)} seeds ({part} of each: {wanted}), "
        f"{cpu_s / max(len(records), 1):.1f} s of CPU each"
    )
    for words, figure, holds in verdicts(records, tallies):
        print(f"  {words:55s} {figure:>18s}  {'none' if holds is None else 'holds' if holds else 'MISSED'}")
    print(f"  {coverage_by_parameter(tallies)}")
    print("\n" + "\n".join(table(tallies)))
    print("\n" + "\n".join(faults(records)))


def chosen(seed: int, share: Fraction, only: str) -> list[LogSet]:
    """The sets of a seed that are asked for."""
    return [one for one in sets_of(seed) if in_share(one, share) and only in one.key]


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=100, help="first seed")
    parser.add_argument("--seeds", type=int, default=10, help="how many seeds")
    parser.add_argument("--jobs", type=int, default=1, help="processes at once")
    parser.add_argument("--out", type=Path, required=True, help="file of the answers; added to, never overwritten")
    parser.add_argument("--only", default="", help="only sets with this in their key")
    parser.add_argument("--share", type=share_of, default=Fraction(1), help="part of the sets of each seed, as 2/5")
    parser.add_argument("--most", type=int, default=None, help="stop after so many sets of each seed")
    parser.add_argument("--report", action="store_true", help="only print what the file has")
    arguments = parser.parse_args()
    if arguments.jobs < 1 or arguments.seeds < 1 or arguments.first < 0:
        parser.error("--jobs and --seeds are whole numbers from 1 on, --first from 0 on.")
    state = state_of_code()
    sets = [
        one
        for seed in range(arguments.first, arguments.first + arguments.seeds)
        for one in chosen(seed, arguments.share, arguments.only)[: arguments.most]
    ]
    if not arguments.report:
        run(sets, arguments.jobs, arguments.out, state)
    wanted = {one.key for one in sets}
    records = [record for record in done_in(arguments.out, state) if record["key"] in wanted]
    report(records, arguments.share, len(wanted))


if __name__ == "__main__":
    main()
