"""Diagnoses of truth made another way: python -m tests.benchmarks.foreign_diagnosis --reference third --out FILE

The cases of the third to the sixth reference (tests.truth) are diagnosed; the answers go to FILE, a line
of JSON each. Called again with the same FILE it does what is left. Answers of another state of the code
are neither counted nor taken for done. A case takes about 5 s of CPU, with --vary (the same logs resampled, held,
interpolated, with a clock that jitters) seven times as much. Printed are counts beside what is asked, names by kind,
intervals by parameter, errors on runs never seen, and every set that went wrong, by the key that --only repeats.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import numpy as np

import vehicle
from tests.benchmarks.diagnosis import done_in
from tests.diagnosis.foreign_sets import REFERENCES, Record, build_record, draw_cases, name_case
from tests.diagnosis.foreign_tally import print_tables, summarise_unseen, tally_records
from tests.truth.cases import KINDS, TruthCase

Work = tuple[str, TruthCase, bool]


def digest_code() -> str:
    """A digest of all that decides an answer: the sources that diagnose, and those of the truth."""
    digest, here = hashlib.sha256(), Path(__file__).parents[1]
    files = [*Path(str(vehicle.__file__)).parent.rglob("*"), *(here / "truth").glob("*.py"),
             here / "diagnosis" / "foreign_sets.py"]  # fmt: skip
    for file in sorted(file for file in files if file.suffix in (".py", ".toml", ".csv")):
        if not file.name.startswith("test_"):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def answer_work(work: Work) -> Record:
    """The record of one case."""
    return build_record(*work)


def iter_answers(works: Sequence[Work], jobs: int) -> Iterator[Record]:
    """Answers as they come, from so many processes at once."""
    if jobs == 1:
        yield from map(answer_work, works)
        return
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as pool:
        for future in as_completed([pool.submit(answer_work, work) for work in works]):
            yield future.result()


def run_cases(works: Sequence[Work], jobs: int, out: Path, state: str) -> None:
    """Diagnose what is left and add the answers to the file; with variations where a case asks for them."""
    known = {record["key"]: "varied" in record or "error" in record for record in done_in(out, state)}
    left = [
        work for work in works if not (name_case(*work[:2]) in known and (known[name_case(*work[:2])] or not work[2]))
    ]
    is_cut_off = out.exists() and not out.read_bytes().endswith(b"\n") and out.stat().st_size
    with out.open("a", encoding="utf-8") as file:
        file.write("\n" if is_cut_off else "")
        for number, record in enumerate(iter_answers(left, jobs), len(works) - len(left) + 1):
            file.write(json.dumps({**record, "state": state}) + "\n")
            file.flush()
            said = ", ".join(record["named"]) or record.get("error", "no name")
            print(f"{number:5d} of {len(works)}  {record['key']:80s} {said}", flush=True)


def report_records(records: Sequence[Record]) -> None:
    """Print all tables."""
    cpu_s = sum(record["cpu_s"] for record in records)
    print(f"\n{len(records)} sets, {cpu_s / max(len(records), 1):.1f} s of CPU each")
    tally = tally_records(records)
    print("\n".join(print_tables(tally)))
    print("\n  Errors on runs never seen, the file's tractor -> the diagnosed one")
    print("\n".join(summarise_unseen(records)))
    print("\n" + "\n".join(tally.complaints))


def choose_works(arguments: argparse.Namespace) -> list[Work]:
    """The cases asked for, those of a seed shuffled, so that the first of them are a fair sample of all."""
    works = []
    for seed in range(arguments.first, arguments.first + arguments.seeds):
        cases = draw_cases(arguments.reference, seed, arguments.kinds)
        mixed = [cases[place] for place in np.random.default_rng([seed, 23]).permutation(len(cases))]
        chosen = [case for case in mixed if arguments.only in name_case(arguments.reference, case)]
        works += [(arguments.reference, case, arguments.vary) for case in chosen[: arguments.most]]
    return works


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--reference", choices=sorted(REFERENCES), required=True, help="which truth")
    parser.add_argument("--first", type=int, default=100, help="first seed")
    parser.add_argument("--seeds", type=int, default=1, help="how many seeds")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=None, help="only these kinds of cases")
    parser.add_argument("--only", default="", help="only cases with this in their key")
    parser.add_argument("--most", type=int, default=None, help="stop after so many cases of each seed")
    parser.add_argument("--vary", action="store_true", help="diagnose the same logs written down in six other ways too")
    parser.add_argument("--jobs", type=int, default=1, help="processes at once")
    parser.add_argument("--out", type=Path, required=True, help="file of the answers; added to, never overwritten")
    parser.add_argument("--report", action="store_true", help="only print what the file has, of any state of the code")
    arguments = parser.parse_args()
    if arguments.jobs < 1 or arguments.seeds < 1 or arguments.first < 0:
        parser.error("--jobs and --seeds are whole numbers from 1 on, --first from 0 on.")
    state, works = digest_code(), choose_works(arguments)
    if not arguments.report:
        run_cases(works, arguments.jobs, arguments.out, state)
    wanted = {name_case(*work[:2]) for work in works}
    records = read_last(arguments.out) if arguments.report else done_in(arguments.out, state)
    report_records([record for record in records if record["key"] in wanted])


def read_last(out: Path) -> list[Record]:
    """The last answer to each case in a file, whatever code gave it; a line cut off by a stop is passed over."""
    records: dict[str, Record] = {}
    for line in out.read_text(encoding="utf-8").splitlines() if out.exists() else ():
        try:
            record = json.loads(line)
        except json.JSONDecodeError:
            continue
        records[record["key"]] = record
    return list(records.values())


if __name__ == "__main__":
    main()
