"""How answers are counted, by hand."""

from typing import Any

import pytest

from tests.diagnosis import tally
from tests.diagnosis.log_sets import LogSet
from tests.diagnosis.records import describe_set
from tests.diagnosis.rerecording import Record
from tests.diagnosis.tally import Measure, tally_records
from tests.truth.cases import ColumnClock, Fault, Law, TruthCase


def say(name: str, status: str, low: float = 0.9, high: float = 1.1, **more: object) -> Record:
    """A finding with one value."""
    middle = 0.5 * (low + high)
    return {"id": name, "status": status, "value": {"angle_deg": middle}, "interval": {"angle_deg": [low, high]},
            "visible": 0.1, "equivalent_to": [], "law": None, **more}  # fmt: skip


def build(case: TruthCase, *said: Record, **more: object) -> Record:
    """A record as a diagnosis would leave it."""
    named = [one["id"] for one in said if one["status"] == "named"]
    return {**describe_set(LogSet("fourth", case)), "named": named, "said": list(said), "unexplained": 0.0,
            "cpu_s": 4.0, "memory_mb": 300, "savable": True, **more}  # fmt: skip


def hide(kind: str, size: float = 1.0, is_faint: bool = False) -> TruthCase:
    ids = frozenset({"steering_offset"})
    return TruthCase(
        kind, 1, {"steering_offset": {"angle_deg": size}}, allowed=ids, wanted=frozenset() if is_faint else ids
    )


def drive(after: dict[str, tuple[float, float | None]]) -> Record:
    """Errors on unseen runs: 2 and 8 cm and half a degree before."""
    before = {"5": {"cm": 2.0, "deg": 0.5}, "20": {"cm": 8.0, "deg": 0.5}}
    return {"before": before, "after": before | {key: {"cm": cm, "deg": deg} for key, (cm, deg) in after.items()}}


RIGHT, WRONG = say("steering_offset", "named"), say("wheel_slip", "named")
LIKELY = say("steering_offset", "likely")
EFFECT, CLEAN = hide("effect"), TruthCase("clean", 1)
SET, OTHER_SET = (
    say("heading_bias", "equivalent", equivalent_to=[name]) for name in ("steering_offset", "antenna_right")
)
FAULT = TruthCase("fault", 1, faults=(Fault("position_frozen", 1, 20.0),), allowed=frozenset({"position_frozen"}))
LATE = TruthCase("column", 1, columns={"heading": ColumnClock(delay_s=0.4)}, allowed=frozenset({"heading_delay"}))
LAW = TruthCase("law", 1, laws=(Law("steering_offset", "over_minutes", {"start": 0.0, "per_minute": 2.0}),),
                allowed=frozenset({"steering_offset"}))  # fmt: skip
OUTSIDE = TruthCase("outside", 1, outside={"gyro_walk": {"size_deg": 2.0}}, hint_words=("heading",))
HINT = {"depends_on": None, "instrument": "heading", "block": None, "words": ""}
VARIED = {"5 Hz": {"named": ["wheel_slip"], "said": [WRONG]}, "held": {"named": ["steering_offset"], "said": [RIGHT]}}


def find(run: str, from_s: float, name: str = "position_frozen") -> Record:
    """A record of a fault that begins in run two at 120 s and is said to be somewhere."""
    hidden = [{"id": "position_frozen", "run": "two", "from_s": 120.0, "to_s": None}]
    return build(FAULT, faults=hidden, faults_said=[{"id": name, "run": run, "from_s": from_s, "to_s": None}])


def tell(column: str, delay_s: float, **more: Any) -> Record:
    """A record of a late heading in which a column is said to be late."""
    empty = {"hold_s": None, "filter_s": None, "clock_offset_s": None, "words": ""}
    return build(LATE, columns=[{"column": column, "delay_s": delay_s, **empty, **more}])


def mix(outcome: str) -> Record:
    return {**describe_set(LogSet("mixups", CLEAN, "speed_mps in km/h")), "outcome": outcome, "fixes": []}


COUNTS: list[tuple[Measure, Record, str]] = [
    (tally.CLEAR, build(EFFECT, RIGHT), "1/1"),
    (tally.CLEAR, build(EFFECT), "0/1"),
    (tally.CLEAR, build(EFFECT, LIKELY), "0/1"),
    (tally.CLEAR, build(EFFECT, error="LogError: no rows"), "0/1"),
    (tally.CLEAR, build(hide("effect", is_faint=True), RIGHT), "-"),
    (tally.FAINT, build(hide("effect", is_faint=True), LIKELY), "1/1"),
    (tally.FAINT, build(hide("effect", is_faint=True)), "0/1"),
    (tally.FAINT, build(EFFECT, LIKELY), "-"),
    (tally.FALSE, build(EFFECT, RIGHT, WRONG), "1/1"),
    (tally.FALSE, build(EFFECT, RIGHT), "0/1"),
    (tally.FALSE_OUTSIDE, build(EFFECT, WRONG), "-"),
    (tally.FALSE_OUTSIDE, build(OUTSIDE, say("heading_bias", "named")), "1/1"),
    (tally.REFUTED_TRUE, build(EFFECT, say("steering_offset", "refuted")), "1/1"),
    (tally.TOLD_TRUE, build(hide("one_sided"), SET), "1/1"),
    (tally.EQUIVALENT_FALSE, build(hide("one_sided"), SET), "0/1"),
    (tally.EQUIVALENT_FALSE, build(hide("one_sided"), OTHER_SET), "1/1"),
    (tally.LIKELY_RIGHT, build(EFFECT, LIKELY, say("wheel_slip", "likely")), "1/2"),
    (tally.REST, build(EFFECT, RIGHT), "1/1"),
    (tally.REST, build(EFFECT, RIGHT, unexplained=0.2), "0/1"),
    (tally.REST, build(EFFECT), "-"),
    (tally.INSIDE, build(EFFECT, RIGHT), "1/1"),
    (tally.INSIDE, build(hide("effect", 1.3), LIKELY), "0/1"),
    (tally.INSIDE, build(EFFECT, say("steering_offset", "equivalent")), "-"),
    (tally.IN_TIME, find("two", 124.0), "1/1"),
    (tally.IN_TIME, find("two", 124.0, "position_lost"), "1/1"),
    (tally.IN_TIME, find("two", 130.0), "0/1"),
    (tally.FAULT_FOUND, find("two", 130.0), "1/1"),
    (tally.FAULT_FOUND, find("one", 120.0), "0/1"),
    (tally.FAULT_FALSE, find("one", 120.0), "1/1"),
    (tally.COLUMN_FOUND, tell("heading", 0.45), "1/1"),
    (tally.COLUMN_FOUND, tell("heading", 0.1), "0/1"),
    (tally.COLUMN_FOUND, build(LATE, say("heading_delay", "named")), "1/1"),
    (tally.COLUMN_FOUND, tell("speed", 0.4), "0/1"),
    (tally.COLUMN_FALSE, tell("speed", 0.4), "1/1"),
    (tally.LAW_RIGHT, build(LAW, say("steering_offset", "named", law={"kind": "over_minutes", "values": {}})), "1/1"),
    (tally.LAW_RIGHT, build(LAW, say("steering_offset", "named", law={"kind": "by_speed", "values": {}})), "0/1"),
    (tally.LAW_RIGHT, build(LAW, RIGHT), "0/1"),
    (tally.CLEAN, build(CLEAN), "1/1"),
    (tally.CLEAN, build(CLEAN, WRONG), "0/1"),
    (tally.CLEAN, build(CLEAN, error="LogError: no"), "0/1"),
    (tally.CLEAN, build(EFFECT), "-"),
    (tally.HINT, build(OUTSIDE, hints=[HINT]), "1/1"),
    (tally.HINT, build(OUTSIDE, depends_on=["Heading error over time"]), "1/1"),
    (tally.HINT, build(OUTSIDE, depends_on=["speed"]), "0/1"),
    (tally.WORSE, build(EFFECT, unseen=drive({"20": (9.0, 0.5)})), "1/1"),
    (tally.WORSE, build(EFFECT, unseen=drive({"20": (8.0, 0.6)})), "1/1"),
    (tally.WORSE, build(EFFECT, unseen=drive({"20": (8.05, None)})), "0/1"),
    (tally.WORSE, build(EFFECT, unseen=drive({"20": (9.0, 0.5)}), savable=False), "0/1"),
    (tally.UNSAVED_WORSE, build(EFFECT, unseen=drive({"20": (9.0, 0.5)}), savable=False), "1/1"),
    (tally.BETTER, build(EFFECT, unseen=drive({})), "-"),
    (tally.FLIPS, build(EFFECT, RIGHT, varied=VARIED), "1/2"),
    (tally.LOSSES, build(EFFECT, RIGHT, varied=VARIED), "1/2"),
    (tally.MIXED, mix("right"), "1/1"),
    (tally.MIXED_WRONG, mix("wrong"), "1/1"),
    (tally.MIXED_TOLD, mix("remarked"), "1/1"),
    (tally.MIXED_SILENT, {**mix("right"), "outcome": "silent"}, "1/1"),
]  # fmt: skip


@pytest.mark.parametrize(("what", "record", "count"), COUNTS, ids=lambda one: getattr(one, "words", ""))
def test_counts_by_hand(what: Measure, record: Record, count: str) -> None:
    assert str(tally_records([record]).get(what)) == count


def test_an_equivalent_set_is_a_name_only_where_drives_are_narrow() -> None:
    narrow = tally_records([build(hide("one_sided"), SET)])
    assert not any("steering_offset is" in line for line in narrow.complaints)
    assert any("steering_offset is" in line for line in tally_records([build(hide("effect"), SET)]).complaints)
