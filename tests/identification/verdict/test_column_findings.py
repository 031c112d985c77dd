"""Ages of columns are those of the effects found."""

from tests.truth.drives import straight
from tests.truth.second import Second
from vehicle.identification.logs.reader import build_log
from vehicle.identification.verdict.diagnosis_types import NAMED, REFUTED, Finding
from vehicle.identification.verdict.log_findings import describe_columns


def finding(name: str, value: float | None, status: str = NAMED) -> Finding:
    values = None if value is None else {"time_s": value}
    return Finding(name, status, values, None, None, None, None, "s", "position to antenna", f"{name} it is.")


def test_ages_come_from_what_was_found() -> None:
    found = [finding("position_delay", 0.3), finding("heading_filter", 0.6), finding("clock_offset_speed", -0.2)]
    by_column = {told.column: told for told in describe_columns([], [*found, finding("heading_delay", None, REFUTED)])}
    assert set(by_column) == {"position", "heading", "speed"}
    assert by_column["position"].delay_s == 0.3 and by_column["position"].words == "position_delay it is."
    assert by_column["heading"].filter_s == 0.6 and by_column["heading"].delay_s is None
    assert by_column["speed"].clock_offset_s == -0.2


def test_a_late_receiver_is_late_in_both_columns() -> None:
    told = describe_columns([], [finding("gnss_latency", 0.25)])
    assert [(one.column, one.delay_s) for one in told] == [("position", 0.25), ("heading", 0.25)]


def test_what_was_corrected_is_told_with_its_log() -> None:
    frame = Second({}, 3).log(straight(90.0, seconds=60.0))
    log = build_log(frame.assign(speed_mps=1.4 * frame.speed_mps), "line")
    (told,) = describe_columns([log], [])
    assert told.column == "speed" and told.words.startswith("line: speed_mps reads 40 % more")
