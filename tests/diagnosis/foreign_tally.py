"""Counts of what diagnoses made of references that share nothing with the simulator."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from tests.diagnosis.rerecording import (
    EQUIVALENT,
    LIKELY,
    NAMED,
    REFUTED,
    Record,
    describe_said,
    find_said,
    list_flips,
    list_losses,
)
from tests.diagnosis.tally import Count
from tests.truth.effects import PLACES

CLEAR_KINDS = ("effect", "pair", "closed_loop", "column", "mixed", "odd_run")
NARROW_KINDS = ("one_sided", "one_speed")  # where an equivalent set is as good as a name
ONSET_WITHIN_S, TIME_WITHIN, TIME_WITHIN_S, SCALE_WITHIN = 5.0, 0.4, 0.1, 0.03
WORSE_FACTOR, WORSE_CM = 1.02, 0.1  # chosen: below both the error of unseen runs is called the same
SAME_FAULTS = (frozenset({"position_lost", "position_frozen"}), frozenset({"position_lost", "position_jump"}))
WANTED = {
    "clear effects named": (0.98, True), "sets with a wrong name": (0.005, False),
    "outside: a wrong name": (0.02, False), "outside: a useful hint": (0.5, True),
    "intervals that hold (named and likely)": (0.93, True), "faults found within 5 s": (0.95, True),
    "saved, and worse on unseen runs": (0.0, False), "sets whose names flip": (0.0, False),
}  # fmt: skip
"""What is asked: a share, and whether it is the least (True) or the most."""


@dataclass
class ForeignTally:
    """Counts of many records: shares by what they count, intervals by parameter, names by kind, and what went wrong."""

    counts: dict[str, Count] = field(default_factory=dict)
    coverage: dict[str, dict[str, Count]] = field(default_factory=dict)
    kinds: dict[str, dict[str, Count]] = field(default_factory=dict)
    complaints: list[str] = field(default_factory=list)

    def add(self, what: str, right: bool) -> None:
        """One more of a count."""
        self.counts.setdefault(what, Count()).add(right)

    def complain(self, record: Record, words: str) -> None:
        """One more of what went wrong."""
        self.complaints.append(f"{record['key']}: {words}")


def tally_records(records: Iterable[Record]) -> ForeignTally:
    """All counts; a set that ended in an error said nothing."""
    tally = ForeignTally()
    for record in records:
        tally.add("sets that ended in an error", "error" in record)
        if "error" in record:
            tally.complain(record, f"ended in {record['error']}")
        for count in (count_wanted, count_wrong, count_likely, count_coverage, count_faults, count_columns, count_laws,
                      count_clean, count_outside, count_unseen, count_flips):  # fmt: skip
            count(tally, record)
    return tally


def list_equivalent(record: Record) -> list[set[str]]:
    """Sets of causes of which one is there and the data cannot tell which."""
    return [{one["id"], *one["equivalent_to"]} for one in record["said"] if one["status"] == EQUIVALENT]


def count_wanted(tally: ForeignTally, record: Record) -> None:
    """Effects that should be named; in narrow drives an equivalent set with them will do."""
    for name in record["wanted"]:
        if record["kind"] == "fault":
            continue
        said = find_said(record, name)
        among = any(name in ids for ids in list_equivalent(record))
        right = name in record["named"] or (among and record["kind"] in NARROW_KINDS)
        by_kind = tally.kinds.setdefault(record["kind"], {})
        by_kind.setdefault(NAMED, Count()).add(right)
        by_kind.setdefault("named, likely or equivalent", Count()).add(right or among or said["status"] == LIKELY)
        by_kind.setdefault(REFUTED, Count()).add(said["status"] == REFUTED)
        if record["kind"] in CLEAR_KINDS:
            tally.add("clear effects named", right)
        if not right:
            tally.complain(record, f"{name} is {said['status'] or 'not said'} {describe_said(said)}")


def count_wrong(tally: ForeignTally, record: Record) -> None:
    """Names, and equivalent sets, without anything that may rightly be said."""
    allowed = set(record["allowed"])
    wrong = [name for name in record["named"] if name not in allowed]
    tally.add("sets with a wrong name", bool(wrong))
    tally.kinds.setdefault(record["kind"], {}).setdefault("wrong", Count()).add(bool(wrong))
    for name in wrong:
        tally.complain(record, f"WRONG NAME {name} {describe_said(find_said(record, name))}")
    for ids in list_equivalent(record):
        tally.add("equivalent sets without a right one", not ids & allowed)
    for one in record.get("faults_said", ()):
        right = any(
            is_same_fault(one["id"], hidden["id"]) and one["run"] == hidden["run"] for hidden in record["faults"]
        )
        tally.add("faults said that are not there", not right)
        if not right:
            tally.complain(record, f"WRONG FAULT {one['id']} in {one['run']} from {one['from_s']:.1f} s")


def count_likely(tally: ForeignTally, record: Record) -> None:
    """Likely effects that are there."""
    for one in record["said"]:
        if one["status"] == LIKELY:
            tally.add("likely ones right", one["id"] in record["allowed"])
            if one["id"] not in record["allowed"]:
                tally.complain(record, f"likely, not hidden: {one['id']} {describe_said(one)}")


def list_true_sizes(record: Record) -> dict[str, float]:
    """The size of each hidden cause that has one number: effects without a law, delays and scales of columns."""
    by_law = {law["effect"] for law in record["laws"]}
    sizes = {}
    for name, values in record["hidden"].items():
        key = next((key for key in values if key not in PLACES), None)
        if name not in by_law and key is not None and values[key] is not None:
            sizes[name] = values[key]
    for column, clock in record["clocks"].items():
        shift = clock.get("offset_s", 0.0) + clock.get("delay_s", 0.0)
        if "drift_s_per_min" not in clock and shift:
            sizes[f"clock_offset_{column}"] = shift
        for name, key in (("delay", "delay_s"), ("filter", "filter_s"), ("scale", "scale")):
            if key in clock:
                sizes[f"{column}_{name}"] = clock[key]
    return sizes


def count_coverage(tally: ForeignTally, record: Record) -> None:
    """True sizes inside the intervals that were given with them."""
    for name, size in list_true_sizes(record).items():
        said = find_said(record, name)
        key = next((key for key in said["interval"] or () if key not in PLACES), None)
        if said["status"] not in (NAMED, LIKELY) or key is None:
            continue
        low, high = said["interval"][key]
        inside = (low is None or low <= size) and (high is None or size <= high)
        tally.coverage.setdefault(name, {}).setdefault(said["status"], Count()).add(inside)
        tally.add("intervals that hold (named and likely)", inside)
        if not inside:
            tally.complain(record, f"{name} {size:.3g} is outside {describe_said(said)}")


def is_same_fault(one: str, other: str) -> bool:
    """Whether two ids are the same fault, or two that look the same."""
    return one == other or any({one, other} <= same for same in SAME_FAULTS)


def count_faults(tally: ForeignTally, record: Record) -> None:
    """Faults found in their run, and those whose onset is within 5 s."""
    for fault in record["faults"]:
        onsets = [one["from_s"] for one in record.get("faults_said", ())
                  if is_same_fault(one["id"], fault["id"]) and one["run"] == fault["run"]]  # fmt: skip
        near = any(abs(onset - fault["from_s"]) <= ONSET_WITHIN_S for onset in onsets)
        tally.add("faults found", bool(onsets))
        tally.add("faults found within 5 s", near)
        if not near:
            tally.complain(
                record, f"{fault['id']} from {fault['from_s']:.1f} s in {fault['run']}: {onsets or 'not found'}"
            )


def is_time_near(said: float | None, true: float) -> bool:
    """Whether a time is right within two fifths, or a tenth of a second."""
    return said is not None and abs(said - true) <= max(TIME_WITHIN * abs(true), TIME_WITHIN_S)


def is_column_found(record: Record, column: str, clock: dict[str, float]) -> bool:
    """Whether what is wrong with a column's clock was said with its size, as a column or by a name."""
    names = {"delay_s": f"{column}_delay", "filter_s": f"{column}_filter", "scale": f"{column}_scale",
             "offset_s": f"clock_offset_{column}"}  # fmt: skip
    if any(key in clock and name in record["named"] for key, name in names.items()):
        return True
    said = next((one for one in record.get("columns", ()) if one["column"] == column), None)
    if said is None:
        return False
    shift = clock.get("delay_s", 0.0) + clock.get("offset_s", 0.0)
    shifts = [sum(said[key] or 0.0 for key in ("delay_s", "clock_offset_s")), said["delay_s"], said["clock_offset_s"]]
    return (
        (shift != 0.0 and any(is_time_near(one, shift) for one in shifts))
        or ("hold_s" in clock and is_time_near(said["hold_s"], clock["hold_s"]))
        or ("filter_s" in clock and is_time_near(said["filter_s"], clock["filter_s"]))
        or ("scale" in clock and said.get("scale") is not None and abs(said["scale"] - clock["scale"]) < SCALE_WITHIN)
    )


def count_columns(tally: ForeignTally, record: Record) -> None:
    """Columns with a clock of their own that were found, and columns said to have one that have none."""
    for column, clock in record["clocks"].items():
        found = is_column_found(record, column, clock)
        tally.add("columns with a clock of their own found", found)
        if not found:
            tally.complain(record, f"column {column} {clock} was not found")
    frozen = {"position", "heading"} if "gnss_latency" in record["allowed"] else set()
    for one in record.get("columns", ()):
        wrong = one["column"] not in record["clocks"] and one["column"] not in frozen and not record["faults"]
        tally.add("columns said late that are not", wrong)
        if wrong:
            tally.complain(record, f"WRONG COLUMN {one['column']}: {one['words']}")


def count_laws(tally: ForeignTally, record: Record) -> None:
    """Laws of named and likely effects that are of the right kind."""
    for law in record["laws"]:
        said = find_said(record, law["effect"])
        kind = said["law"]["kind"] if said["law"] else ""
        right = kind == law["kind"] and said["status"] in (NAMED, LIKELY)
        tally.add("laws right", right)
        if said["status"] == NAMED and not right:
            tally.complain(
                record, f"LAW {law['effect']} {law['kind']} said as {kind or 'constant'} {describe_said(said)}"
            )


def count_clean(tally: ForeignTally, record: Record) -> None:
    """Sets in which nothing is hidden: no name, no fault, and the rest explained."""
    if (
        record["wanted"]
        or record["outside"]
        or record["laws"]
        or record["faults"]
        or record["clocks"]
        or record["hidden"]
    ):
        return
    silent = not (record["named"] or record.get("faults_said") or "error" in record)
    tally.add("clean sets silent", silent)
    tally.add("clean sets with nothing unexplained", record.get("unexplained") == 0.0)
    tally.add("clean sets that change the tractor file", bool(record.get("unseen")) and is_changed(record))


def has_hint(record: Record) -> bool:
    """Whether a hint, or what the rest depends on, has one of the words it should have."""
    texts = [*record.get("depends_on", ()), *(str(one.get(key) or "") for one in record.get("hints", ())
             for key in ("depends_on", "instrument", "block", "words"))]  # fmt: skip
    text = " ".join(texts).lower()
    return any(word.lower() in text for word in record["hint_words"])


def count_outside(tally: ForeignTally, record: Record) -> None:
    """Causes that no effect has: wrong names and hints."""
    if record["kind"] != "outside":
        return
    tally.add("outside: a wrong name", bool(set(record["named"]) - set(record["allowed"])))
    if record["hint_words"]:
        tally.add("outside: a useful hint", has_hint(record))


def is_changed(record: Record) -> bool:
    """Whether the diagnosed tractor drives unseen runs otherwise than the file's."""
    return bool(record["unseen"]["before"] != record["unseen"]["after"])


def is_worse(record: Record) -> bool:
    """Whether the diagnosed tractor is worse on unseen runs at 5 or 20 s."""
    before, after = record["unseen"]["before"], record["unseen"]["after"]
    return any(
        after[key]["both"] > WORSE_FACTOR * before[key]["both"] + WORSE_CM for key in before if key in after
    )  # fmt: skip


def count_unseen(tally: ForeignTally, record: Record) -> None:
    """Sets whose diagnosed tractor is worse on unseen runs, and whether it would be saved."""
    if not record.get("unseen"):
        return
    worse, saved = is_worse(record), record.get("savable", True)
    tally.add("worse on unseen runs", worse)
    tally.add("saved, and worse on unseen runs", worse and saved)
    if is_changed(record):
        tally.add("better, of those that change", not worse)
    if worse:
        before, after = record["unseen"]["before"], record["unseen"]["after"]
        cells = [f"{key} s {before[key]['both']:.1f} -> {after[key]['both']:.1f} cm" for key in before if key in after]
        tally.complain(record, f"WORSE on unseen runs{' (not saved)' if not saved else ''}: {', '.join(cells)}")


def count_flips(tally: ForeignTally, record: Record) -> None:
    """Sets whose names depend on how the logs are written down."""
    if "varied" not in record:
        return
    flips = [f"{how}: {flip}" for how, varied in record["varied"].items() for flip in list_flips(record, varied)]
    tally.add("sets whose names flip", bool(flips))
    tally.add("sets that lose a name", any(list_losses(record, varied) for varied in record["varied"].values()))
    for flip in flips:
        tally.complain(record, f"FLIP {flip}")


def print_tables(tally: ForeignTally) -> list[str]:
    """Lines: counts beside what is asked, names by kind, and intervals by parameter."""
    lines = []
    for what, count in tally.counts.items():
        asked = ""
        if what in WANTED and count.of:
            share, least = WANTED[what]
            holds = count.share >= share if least else count.share <= share
            asked = f"  {'at least' if least else 'at most'} {share:.1%}: {'holds' if holds else 'MISSED'}"
        lines.append(f"  {what:44s} {count!s:>9s} {count.share:7.1%}{asked}")
    lines.append(f"\n  {'kind':14s}{'named':>9s}{'or likely':>11s}{'refuted':>9s}{'wrong':>9s}")
    for kind, counts in tally.kinds.items():
        cells = [counts.get(what, Count()) for what in (NAMED, "named, likely or equivalent", REFUTED, "wrong")]
        lines.append(f"  {kind:14s}{cells[0]!s:>9s}{cells[1]!s:>11s}{cells[2]!s:>9s}{cells[3]!s:>9s}")
    lines.append(f"\n  {'in its interval':24s}{'named':>9s}{'likely':>9s}")
    for name, statuses in sorted(tally.coverage.items()):
        lines.append(f"  {name:24s}{statuses.get(NAMED, Count())!s:>9s}{statuses.get(LIKELY, Count())!s:>9s}")
    return lines


def summarise_unseen(records: Sequence[Record]) -> list[str]:
    """Mean error on unseen runs before and after by kind and horizon."""
    lines = []
    for kind in sorted({record["kind"] for record in records if record.get("unseen")}):
        mine = [record["unseen"] for record in records if record["kind"] == kind and record.get("unseen")]
        cells = []
        for horizon in ("5", "20"):
            rows = [one for one in mine if horizon in one["before"] and horizon in one["after"]]
            if rows:
                before, after = (
                    sum(one[when][horizon]["both"] for one in rows) / len(rows) for when in ("before", "after")
                )
                cells.append(f"{horizon} s {before:6.1f} -> {after:6.1f} cm")
        lines.append(f"  {kind:14s}{len(mine):4d} sets  {'   '.join(cells)}")
    return lines
