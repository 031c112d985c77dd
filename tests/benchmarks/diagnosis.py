"""How often the diagnosis is right: python -m tests.benchmarks.diagnosis --all --share 1/5 --out FILE

Sets of logs with known causes, by references that share no code with the simulator (tests.diagnosis.log_sets), are
diagnosed; the answers go to FILE, a line of JSON each. Called again with the same FILE it does what is left, so it can
be stopped at any time. Answers of another state of the code are neither counted nor taken for done. Each set has a
process of its own, started once the code is compiled. A seed of all references has some 320 sets and takes over an
hour of one core; with --share 1/5 it has a fifth of them, each kind as often as every other in five seeds in a row.
Printed are what is asked of a diagnosis beside what it reached, the same by reference, kind and effect, and every set
that went wrong, by the key that --only repeats. The exit status is 1 if anything that is saved is worse on unseen runs.
"""

import argparse
import hashlib
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator, Sequence
from fractions import Fraction
from multiprocessing.connection import Connection, wait
from pathlib import Path

import vehicle
from tests.diagnosis.log_sets import REFERENCES, LogSet, list_sets, make_demo_set
from tests.diagnosis.records import build_record, describe_set
from tests.diagnosis.rerecording import Record
from tests.diagnosis.tally import WORSE, format_tables, format_unseen, tally_records

THREADS = "OPENBLAS_NUM_THREADS"
SOURCES = ("drawn_sets", "log_sets", "mixups", "records", "rerecording")


def digest_code() -> str:
    """A digest of all that decides an answer: the sources that diagnose, and those of the truth."""
    digest, here = hashlib.sha256(), Path(__file__).parents[1]
    files = [*Path(str(vehicle.__file__)).parent.rglob("*"), *(here / "truth").glob("*.py"),
             *(here / "diagnosis" / f"{name}.py" for name in SOURCES)]  # fmt: skip
    for file in sorted(file for file in files if file.suffix in (".py", ".toml", ".csv")):
        if not file.name.startswith("test_"):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def parse_share(text: str) -> Fraction:
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


def read_answers(out: Path, state: str | None) -> list[Record]:
    """The last answer to each set by a state of the code, or by any (None); a line cut off by a stop is passed over."""
    records: dict[str, Record] = {}
    for line in out.read_text(encoding="utf-8").splitlines() if out.exists() else ():
        try:
            record = json.loads(line)
        except json.JSONDecodeError:
            continue
        if state in (None, record["state"]):
            records[record["key"]] = record
    return list(records.values())


def iter_answers(sets: Sequence[LogSet], jobs: int) -> Iterator[Record]:
    """Answers as they come, each from a process of its own that has what is compiled; so many at once."""
    build_record(make_demo_set("nothing", 1))  # compiles
    context, left, running = multiprocessing.get_context("fork"), list(reversed(sets)), dict[Connection, LogSet]()
    while left or running:
        while left and len(running) < jobs:
            receiver, sender = context.Pipe(duplex=False)
            context.Process(target=send_answer, args=(sender, left[-1])).start()
            sender.close()
            running[receiver] = left.pop()
        for ready in wait(list(running)):
            assert isinstance(ready, Connection)
            one = running.pop(ready)
            try:
                yield ready.recv()
            except EOFError:
                yield describe_set(one) | {"error": "the process was ended, perhaps for want of memory"}


def send_answer(sender: Connection, one: LogSet) -> None:
    """Send the record of a set."""
    sender.send(build_record(one))


def run_sets(sets: Sequence[LogSet], jobs: int, out: Path, state: str) -> None:
    """Diagnose what is left of the sets and add the answers to the file."""
    known = {record["key"] for record in read_answers(out, state)}
    left = [one for one in sets if one.key not in known]
    is_cut_off = out.exists() and not out.read_bytes().endswith(b"\n") and out.stat().st_size
    begun = time.monotonic()
    with out.open("a", encoding="utf-8") as file:
        file.write("\n" if is_cut_off else "")
        for number, record in enumerate(iter_answers(left, jobs) if left else (), 1):
            file.write(json.dumps({**record, "state": state}) + "\n")
            file.flush()
            minutes = (time.monotonic() - begun) / number * (len(left) - number) / 60.0
            said = record.get("error") or record.get("outcome") or ", ".join(record["named"]) or "no name"
            print(
                f"{number} of {len(left)}, {minutes:.0f} min left  {record['key']}: {said}", file=sys.stderr, flush=True
            )


def choose_sets(arguments: argparse.Namespace) -> list[LogSet]:
    """The sets asked for, of every reference and seed in turn, so that a run that is stopped has some of each."""
    groups = [
        [one for one in list_sets(reference, seed, arguments.share, arguments.logs) if arguments.only in one.key]
        for seed in range(arguments.first, arguments.first + arguments.seeds)
        for reference in (REFERENCES if arguments.all else arguments.reference)
        if reference != "real" or seed == arguments.first
    ]
    places = [
        ((place + 0.5) / len(group), number, one)
        for number, group in enumerate(groups)
        for place, one in enumerate(group)
    ]
    return [one for *_, one in sorted(places, key=lambda place: place[:2])]


def report_records(records: Sequence[Record], wanted: int, with_errors: bool) -> int:
    """Print the figures and of how many sets they are; return the exit status."""
    tally = tally_records(sorted(records, key=lambda record: REFERENCES.index(record["reference"])))
    print(f"\n{len(records)} of {wanted} sets\n" + "\n".join(format_tables(tally)))
    if with_errors:
        print("\nErrors on unseen runs\n" + "\n".join(format_unseen(records)))
    print("\nSets that went wrong\n" + "\n".join(tally.complaints))
    return 1 if tally.get(WORSE).right else 0


def build_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--all", action="store_true", help="all references")
    which.add_argument("--reference", nargs="+", choices=REFERENCES, help="only these references")
    parser.add_argument("--first", type=int, default=100, help="first seed")
    parser.add_argument("--seeds", type=int, default=1, help="how many seeds")
    parser.add_argument("--share", type=parse_share, default=Fraction(1), help="part of the sets of each seed, as 2/5")
    parser.add_argument("--only", default="", help="only sets with this in their key")
    parser.add_argument("--logs", nargs=3, action="append", default=[], metavar=("FOLDER", "TRACTOR", "GROUND"),
                        help="more real logs: a folder of CSV files, the tractor file, the ground")  # fmt: skip
    parser.add_argument("--jobs", type=int, default=1, help="processes at once")
    parser.add_argument("--out", type=Path, required=True, help="file of the answers; added to, never overwritten")
    parser.add_argument("--errors", action="store_true", help="also print a row per set of errors on unseen runs")
    parser.add_argument("--report", action="store_true", help="only print what the file has, of any state of the code")
    return parser


def main(given: Sequence[str] | None = None) -> int:
    """Run and print."""
    parser = build_parser()
    arguments = parser.parse_args(given)
    if arguments.jobs < 1 or arguments.seeds < 1 or arguments.first < 0:
        parser.error("--jobs and --seeds are whole numbers from 1 on, --first from 0 on.")
    sets, state = choose_sets(arguments), None if arguments.report else digest_code()
    if state is not None:
        run_sets(sets, arguments.jobs, arguments.out, state)
    wanted = {one.key for one in sets}
    records = [record for record in read_answers(arguments.out, state) if record["key"] in wanted]
    return report_records(records, len(wanted), arguments.errors)


if __name__ == "__main__":
    if os.environ.get(THREADS) != "1":  # it is read when numpy is loaded, and threads would count as CPU
        os.execve(
            sys.executable,
            [sys.executable, "-m", "tests.benchmarks.diagnosis", *sys.argv[1:]],
            {**os.environ, THREADS: "1"},
        )
    sys.exit(main())
