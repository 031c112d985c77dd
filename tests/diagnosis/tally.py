"""Counts of what diagnoses made of sets with known causes, and the table of what is asked of them.

A count is kept over all sets, by reference, by kind of case and, where it is about one effect, by effect.
"""

import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from scipy.stats import binomtest

from tests.diagnosis.mixups import REMARKED, RIGHT, SILENT, WRONG
from tests.diagnosis.rerecording import (
    EQUIVALENT,
    LIKELY,
    NAMED,
    REFUTED,
    TOLD,
    Record,
    describe_said,
    find_said,
    list_flips,
    list_losses,
)
from tests.truth.effects import PLACES

CLEAR_KINDS = ("effect", "pair", "closed_loop", "column", "mixed", "odd_run")
NARROW_KINDS = ("one_sided", "one_speed")  # where an equivalent set is as good as a name
ONSET_WITHIN_S, TIME_WITHIN, TIME_WITHIN_S, SCALE_WITHIN = 5.0, 0.4, 0.1, 0.03
WORSE_SHARE, WORSE_LEAST = 1.02, {"cm": 0.1, "deg": 0.03}  # smaller rises are the last digits of instruments
SAME_FAULTS = (frozenset({"position_lost", "position_frozen"}), frozenset({"position_lost", "position_jump"}))
TOTAL, REFERENCE, KIND, EFFECT = "all", "reference", "kind", "effect"
CPU_S, MEMORY_MB = (5.0, 15.0), 500.0  # median and most of 10 minutes of log in 8 runs


@dataclass(frozen=True)
class Measure:
    """What is counted, in words, its head in a narrow column, and the least and the most share that is asked."""

    words: str
    head: str = ""
    least: float = 0.0
    most: float = 1.0

    @property
    def asked(self) -> str:
        """What is asked, in words; empty where nothing is."""
        low, high = f"{100.0 * self.least:g}", f"{100.0 * self.most:g}"
        if self.least > 0.0:
            return f"{low} to {high} %" if self.most < 1.0 else f"{low} %"
        return f"<= {high} %" if self.most < 1.0 else ""


CLEAR, FAINT = Measure("clear effects named", "named", 0.95), Measure("faint ones named or likely", "faint", 0.75)
FALSE, FALSE_OUTSIDE = (
    Measure("sets with a wrong name", "wrong", 0.0, 0.005),
    Measure("of these, causes outside of the catalogue", "outside", 0.0, 0.005),
)
CLEAN, INSIDE = Measure("clean sets silent", "silent", 0.98), Measure("intervals that hold", "inside", 0.93, 0.97)
WORSE = Measure("saved, and worse by 2 % on unseen runs at any horizon", "worse", 0.0, 0.0)
LIKELY_RIGHT = Measure("likely ones right", "likely", 0.80)
FLIPS = Measure("flips when recorded again", "flips", 0.0, 0.02)
MIXED, MIXED_WRONG = (
    Measure("mix-ups read right", "mix-ups", 0.95),
    Measure("mix-ups mended wrongly", "mended", 0.0, 0.0),
)
IN_TIME = Measure("faults found within 5 s", "faults", 0.90)
ASKED = (CLEAR, FAINT, FALSE, FALSE_OUTSIDE, CLEAN, INSIDE, WORSE, LIKELY_RIGHT, FLIPS, MIXED, MIXED_WRONG, IN_TIME)
MIXED_TOLD, MIXED_SILENT = Measure("mix-ups left alone with a remark"), Measure("mix-ups without a word")
ERRORS, REFUTED_TRUE = (
    Measure("sets that ended in an error", "error"),
    Measure("effects that are there, refuted", "refuted"),
)
TOLD_TRUE = Measure("all effects named, likely or equivalent", "told")
EQUIVALENT_FALSE = Measure("equivalent sets without a right one")
FAULT_FALSE, FAULT_FOUND = Measure("faults said that are not there"), Measure("faults found at any time")
COLUMN_FOUND, COLUMN_FALSE = Measure("clocks of columns found"), Measure("columns said late that are not")
LAW_RIGHT, HINT = Measure("laws of the right kind"), Measure("outside of the catalogue: a useful hint")
EXPLAINED, CLEAN_CHANGED = Measure("clean sets with nothing unexplained"), Measure("clean sets that change the tractor")
BETTER, UNSAVED_WORSE = (
    Measure("saved and changed: not worse on unseen runs"),
    Measure("worse on unseen runs, saved or not"),
)
LOSSES = Measure("names lost when recorded again")
REST = Measure("sets with all effects named: nothing unexplained")
ALSO = (MIXED_TOLD, MIXED_SILENT, ERRORS, TOLD_TRUE, REFUTED_TRUE, EQUIVALENT_FALSE, FAULT_FALSE, FAULT_FOUND,
        COLUMN_FOUND, COLUMN_FALSE, LAW_RIGHT, HINT, EXPLAINED, CLEAN_CHANGED, BETTER, UNSAVED_WORSE,
        LOSSES, REST)  # fmt: skip


@dataclass
class Count:
    """So many of so many."""

    right: int = 0
    of: int = 0

    def add(self, right: bool) -> None:
        """One more."""
        self.right, self.of = self.right + bool(right), self.of + 1

    @property
    def share(self) -> float:
        """From 0 to 1; 0 of none is 0."""
        return self.right / self.of if self.of else 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """The interval of 95 % of the share (Clopper and Pearson)."""
        if not self.of:
            return 0.0, 1.0
        bounds = binomtest(self.right, self.of).proportion_ci(0.95, "exact")
        return float(bounds.low), float(bounds.high)

    def __str__(self) -> str:
        return f"{self.right}/{self.of}" if self.of else "-"


@dataclass
class Tally:
    """Counts by axis, row of it and measure, costs by reference, and every set that went wrong."""

    counts: dict[tuple[str, str, Measure], Count] = field(default_factory=dict)
    costs: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    complaints: list[str] = field(default_factory=list)

    def add(self, what: Measure, record: Record, right: bool, effect: str = "") -> None:
        """One more of a count."""
        rows = [(TOTAL, ""), (REFERENCE, record["reference"]), (KIND, record["kind"])]
        for axis, row in [*rows, *([(EFFECT, effect)] if effect else [])]:
            self.counts.setdefault((axis, row, what), Count()).add(right)

    def get(self, what: Measure, axis: str = TOTAL, row: str = "") -> Count:
        """A count; none of none where nothing was counted."""
        return self.counts.get((axis, row, what), Count())

    def list_rows(self, axis: str) -> list[str]:
        """Rows of an axis as they came."""
        return list(dict.fromkeys(row for each, row, _ in self.counts if each == axis))

    def complain(self, record: Record, words: str) -> None:
        """One more of what went wrong."""
        self.complaints.append(f"{record['key']}: {words}")


def tally_records(records: Iterable[Record]) -> Tally:
    """All counts; a set that ended in an error said nothing."""
    tally = Tally()
    for record in records:
        tally.add(ERRORS, record, "error" in record)
        if "error" in record:
            tally.complain(record, f"ended in {record['error']}")
        if record["kind"] == "mixups":
            # What became of a mix-up
            outcome = record.get("outcome", SILENT)
            for what, name in ((MIXED, RIGHT), (MIXED_WRONG, WRONG), (MIXED_TOLD, REMARKED), (MIXED_SILENT, SILENT)):
                tally.add(what, record, outcome == name)
            if outcome in (WRONG, SILENT):
                said = ", ".join([*record.get("fixes", ()), *record["named"]]) or "nothing"
                tally.complain(record, f"MIX-UP {outcome}: {said}")
            continue
        if "cpu_s" in record:
            tally.costs.setdefault(record["reference"], []).append((record["cpu_s"], record["memory_mb"]))
        count_unseen(tally, record)
        if record["kind"] != "real":  # nobody knows what is true of them
            for count in (count_effects, count_wrong, count_likely, count_coverage, count_faults, count_columns,
                          count_laws, count_clean, count_hints, count_flips):  # fmt: skip
                count(tally, record)
    return tally


def list_equivalent(record: Record) -> list[set[str]]:
    """Sets of causes of which one is there and the data cannot tell which."""
    return [{one["id"], *one["equivalent_to"]} for one in record["said"] if one["status"] == EQUIVALENT]


def count_effects(tally: Tally, record: Record) -> None:
    """Effects that should be named; in narrow drives an equivalent set with them will do. Faint ones may be likely."""
    if record["kind"] == "fault":
        return
    for name in record["wanted"]:
        status, among = find_said(record, name)["status"], any(name in ids for ids in list_equivalent(record))
        right = name in record["named"] or (among and record["kind"] in NARROW_KINDS)
        tally.add(TOLD_TRUE, record, right or among or status in TOLD, name)
        tally.add(REFUTED_TRUE, record, status == REFUTED, name)
        if record["kind"] in CLEAR_KINDS:
            tally.add(CLEAR, record, right, name)
        if not right:
            tally.complain(record, f"{name} is {status or 'not said'} {describe_said(find_said(record, name))}")
    if record["wanted"] and set(record["wanted"]) <= set(record["named"]):
        tally.add(REST, record, record["unexplained"] == 0.0)
    for name in set(record["hidden"]) & set(record["allowed"]) if not record["wanted"] else ():
        tally.add(FAINT, record, find_said(record, name)["status"] in (NAMED, LIKELY), name)


def count_wrong(tally: Tally, record: Record) -> None:
    """Names, and equivalent sets, without anything that may rightly be said; faults that are not there."""
    allowed = set(record["allowed"])
    wrong = [name for name in record["named"] if name not in allowed]
    tally.add(FALSE, record, bool(wrong))
    if record["kind"] == "outside":
        tally.add(FALSE_OUTSIDE, record, bool(wrong))
    for name in wrong:
        tally.complain(record, f"WRONG NAME {name} {describe_said(find_said(record, name))}")
    for ids in list_equivalent(record):
        tally.add(EQUIVALENT_FALSE, record, not ids & allowed)
    for one in record.get("faults_said", ()):
        right = any(is_same_fault(one, hidden) for hidden in record["faults"])
        tally.add(FAULT_FALSE, record, not right)
        if not right:
            tally.complain(record, f"WRONG FAULT {one['id']} in {one['run']} from {one['from_s']:.1f} s")


def count_likely(tally: Tally, record: Record) -> None:
    """Likely effects that are there."""
    for one in record["said"]:
        if one["status"] == LIKELY:
            right = one["id"] in record["allowed"]
            tally.add(LIKELY_RIGHT, record, right, one["id"])
            if not right:
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


def count_coverage(tally: Tally, record: Record) -> None:
    """True sizes inside the intervals that were given with named and likely effects."""
    for name, size in list_true_sizes(record).items():
        said = find_said(record, name)
        key = next((key for key in said["interval"] or () if key not in PLACES), None)
        if said["status"] not in (NAMED, LIKELY) or key is None:
            continue
        low, high = said["interval"][key]
        inside = (low is None or low <= size) and (high is None or size <= high)
        tally.add(INSIDE, record, inside, name)
        if not inside:
            tally.complain(record, f"{name} {size:.3g} is outside {describe_said(said)}")


def is_same_fault(one: Record, other: Record) -> bool:
    """Whether two faults of a run are the same, or look the same."""
    ids = {one["id"], other["id"]}
    return one["run"] == other["run"] and (len(ids) == 1 or any(ids <= same for same in SAME_FAULTS))


def count_faults(tally: Tally, record: Record) -> None:
    """Faults found in their run, and those whose onset is within 5 s."""
    for fault in record["faults"]:
        onsets = [one["from_s"] for one in record.get("faults_said", ()) if is_same_fault(one, fault)]
        near = any(abs(onset - fault["from_s"]) <= ONSET_WITHIN_S for onset in onsets)
        tally.add(FAULT_FOUND, record, bool(onsets))
        tally.add(IN_TIME, record, near)
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


def count_columns(tally: Tally, record: Record) -> None:
    """Columns with a clock of their own that were found, and columns said to have one that have none."""
    for column, clock in record["clocks"].items():
        found = is_column_found(record, column, clock)
        tally.add(COLUMN_FOUND, record, found)
        if not found:
            tally.complain(record, f"column {column} {clock} was not found")
    frozen = {"position", "heading"} if "gnss_latency" in record["allowed"] else set()
    for one in record.get("columns", ()):
        wrong = one["column"] not in record["clocks"] and one["column"] not in frozen and not record["faults"]
        tally.add(COLUMN_FALSE, record, wrong)
        if wrong:
            tally.complain(record, f"WRONG COLUMN {one['column']}: {one['words']}")


def count_laws(tally: Tally, record: Record) -> None:
    """Laws of named and likely effects that are of the right kind."""
    for law in record["laws"]:
        said = find_said(record, law["effect"])
        kind = said["law"]["kind"] if said["law"] else ""
        right = kind == law["kind"] and said["status"] in (NAMED, LIKELY)
        tally.add(LAW_RIGHT, record, right, law["effect"])
        if said["status"] == NAMED and not right:
            words = f"LAW {law['effect']} {law['kind']} said as {kind or 'constant'} {describe_said(said)}"
            tally.complain(record, words)


def count_clean(tally: Tally, record: Record) -> None:
    """Sets in which nothing is hidden: no name, no fault, and the rest explained."""
    if any(record[key] for key in ("wanted", "outside", "laws", "faults", "clocks", "hidden")):
        return
    tally.add(CLEAN, record, not (record["named"] or record.get("faults_said") or "error" in record))
    tally.add(EXPLAINED, record, record.get("unexplained") == 0.0)
    tally.add(CLEAN_CHANGED, record, bool(record.get("unseen")) and is_changed(record))


def count_hints(tally: Tally, record: Record) -> None:
    """Causes that no effect has: a hint, or what the rest depends on, has one of the words it should have."""
    if record["kind"] != "outside" or not record["hint_words"]:
        return
    texts = [*record.get("depends_on", ()), *(str(one.get(key) or "") for one in record.get("hints", ())
             for key in ("depends_on", "instrument", "block", "words"))]  # fmt: skip
    text = " ".join(texts).lower()
    tally.add(HINT, record, any(word.lower() in text for word in record["hint_words"]))


def is_changed(record: Record) -> bool:
    """Whether the diagnosed tractor drives unseen runs otherwise than the file's."""
    return bool(record["unseen"]["before"] != record["unseen"]["after"])


def list_rises(record: Record) -> list[str]:
    """Errors on unseen runs that the diagnosed tractor raises, in words."""
    before, after = record["unseen"]["before"], record["unseen"]["after"]
    return [
        f"{horizon} s {old[unit]:.1f} -> {after[horizon][unit]:.1f} {unit}"
        for horizon, old in before.items()
        for unit, least in WORSE_LEAST.items()
        if horizon in after and None not in (old[unit], after[horizon][unit])
        if after[horizon][unit] > WORSE_SHARE * old[unit] + least
    ]


def count_unseen(tally: Tally, record: Record) -> None:
    """Sets whose diagnosed tractor is worse on unseen runs, and whether it would be saved."""
    if not record.get("unseen"):
        return
    rises, saved = list_rises(record), record["savable"]
    tally.add(UNSAVED_WORSE, record, bool(rises))
    tally.add(WORSE, record, bool(rises) and saved)
    if is_changed(record) and saved:
        tally.add(BETTER, record, not rises)
    if rises:
        tally.complain(record, f"WORSE on unseen runs{'' if saved else ' (not saved)'}: {', '.join(rises)}")


def count_flips(tally: Tally, record: Record) -> None:
    """Ways of writing the logs down that change names, or lose them."""
    for how, varied in record.get("varied", {}).items():
        flips = list_flips(record, varied)
        tally.add(FLIPS, record, bool(flips))
        tally.add(LOSSES, record, bool(list_losses(record, varied)))
        for flip in flips:
            tally.complain(record, f"FLIP {how}: {flip}")


# --- printed -------------------------------------------------------------------------------------------------------


def format_measures(tally: Tally, measures: Sequence[Measure]) -> list[str]:
    """A line per measure: what is asked, the share, its count and its interval, and whether it holds."""
    lines = []
    for what in measures:
        count = tally.get(what)
        low, high = count.interval
        share = f"{100.0 * count.share:5.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f})" if count.of else ""
        holds = ("holds" if what.least <= count.share <= what.most else "MISSED") if what.asked and count.of else ""
        lines.append(f"  {what.words:55s}{what.asked:>12s}{count!s:>10s}  {share:24s}{holds}")
    return lines


def format_costs(tally: Tally) -> list[str]:
    """CPU and memory of all sets beside what is asked."""
    costs = [cost for name, ones in tally.costs.items() if name != "real" for cost in ones]
    if not costs:
        return []
    seconds, memory = [cost[0] for cost in costs], [cost[1] for cost in costs]
    rows = (
        ("CPU of a set, s, median", CPU_S[0], statistics.median(seconds)),
        ("CPU of a set, s, most", CPU_S[1], max(seconds)),
        ("memory of a process, MB, most", MEMORY_MB, max(memory)),
    )
    return [
        f"  {words:55s}{f'<= {asked:g}':>12s}{got:10.1f}  {f'{len(costs)} sets':24s}"
        + ("holds" if got <= asked else "MISSED")
        for words, asked, got in rows
    ]


def format_breakdown(tally: Tally, axis: str, measures: Sequence[Measure]) -> list[str]:
    """A line per row of an axis, a column per measure that has a count there; references with their costs."""
    rows = sorted(tally.list_rows(axis)) if axis != REFERENCE else tally.list_rows(axis)
    shown = [what for what in measures if any(tally.get(what, axis, row).of for row in rows)]
    lines = [f"  {axis:22s}" + "".join(f"{what.head:>9s}" for what in shown)
             + (f"{'CPU s':>8s}{'most':>7s}{'MB':>6s}" if axis == REFERENCE else "")]  # fmt: skip
    for row in rows:
        cells = "".join(f"{tally.get(what, axis, row)!s:>9s}" for what in shown)
        costs = tally.costs.get(row, ()) if axis == REFERENCE else ()
        if costs:
            seconds = [cost[0] for cost in costs]
            cells += f"{statistics.median(seconds):8.1f}{max(seconds):7.1f}{max(cost[1] for cost in costs):6.0f}"
        lines.append(f"  {row:22s}{cells}")
    return lines


def format_tables(tally: Tally) -> list[str]:
    """All that is printed: what is asked, what else was counted, and both by reference, kind and effect."""
    return [
        f"  {'':55s}{'asked':>12s}{'count':>10s}  share (95 % interval)",
        *format_measures(tally, ASKED), *format_costs(tally), "", *format_measures(tally, ALSO), "",
        *format_breakdown(tally, REFERENCE, ASKED), "",
        *format_breakdown(tally, KIND, (CLEAR, TOLD_TRUE, FAINT, REFUTED_TRUE, FALSE, INSIDE, LIKELY_RIGHT)), "",
        *format_breakdown(tally, EFFECT, (CLEAR, TOLD_TRUE, FAINT, REFUTED_TRUE, INSIDE, LIKELY_RIGHT)),
    ]  # fmt: skip


def format_unseen(records: Sequence[Record]) -> list[str]:
    """Rows in Markdown: what was named in a set, and errors (cm) on its unseen runs before and after."""
    horizons = ("1", "5", "20")
    lines = [f"| set | named | {' | '.join(f'{one} s, cm' for one in horizons)} | saved |", "|---|---|---|---|---|---|"]
    for record in records:
        if record.get("unseen"):
            before, after = record["unseen"]["before"], record["unseen"]["after"]
            cells = [f"{before[one]['cm']:.1f} -> {after[one]['cm']:.1f}" if one in before else "-" for one in horizons]
            saved = "unchanged" if not is_changed(record) else "yes" if record["savable"] else "no"
            saved += ", WORSE" if list_rises(record) and record["savable"] else ""
            lines.append(f"| {' | '.join([record['key'], ', '.join(record['named']) or '-', *cells, saved])} |")
    return lines
