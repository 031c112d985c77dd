"""The verdict over numbers of the thesis: every number is counted once, and never flattered."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from reports.trials.report import build_trials_table, measure_thesis_agreement, render_trials_page
from tests.printing import print_text
from vehicle.trials.sheets.sheet import ExperimentSheet, TextTable, ThesisComparison

NUMBERS = (
    ThesisComparison("a 1", "radius", "m", 10.0, 10.5),
    ThesisComparison("a 2", "radius", "m", 10.0, 10.51),
    ThesisComparison("a 3", "radius", "m", 10.0, 8.5),
    ThesisComparison("a 4", "radius", "m", 10.0, 8.4),
    ThesisComparison("a 5", "radius", "m", 10.0, None, "no log exists"),
    ThesisComparison("a 6", "radius", "m", 0.0, 1.0),
    ThesisComparison("a 7", "radius", "m", None, 1.0, "no number is printed"),
)
SHEET = ExperimentSheet("a", "Circles (Table 1)", ("Words.",), NUMBERS)
OTHER = ExperimentSheet("b", "Fixed", (), (ThesisComparison("b 1", "slip", "deg", 2.0, 2.0),))


def test_numbers_are_counted_by_how_far_they_are_off() -> None:
    verdict = measure_thesis_agreement([SHEET])
    assert verdict.headline == (
        "4 of 6 numbers of the thesis are reproduced: 1 within 5 %, 2 more within 15 %; 1 differ by more."
    )
    assert verdict.table.rows == (("Circles (Table 1)", "6", "1", "2", "1", "2"),)
    assert "2 cannot be compared; each is listed with the reason." in verdict.sentences
    assert "1 further simulated numbers are not in the thesis." in verdict.sentences


def test_several_experiments_have_a_row_each_and_one_for_all() -> None:
    verdict = measure_thesis_agreement([SHEET, OTHER])
    assert [row[0] for row in verdict.table.rows] == ["Circles (Table 1)", "Fixed", "All"]
    assert verdict.table.rows[-1][1:] == ("7", "2", "2", "1", "2")
    assert verdict.sentences[0] == "Differ by more than 15 %: Circles (Table 1) (1)."


def test_nothing_to_compare_has_no_verdict() -> None:
    assert measure_thesis_agreement([ExperimentSheet("drive", "A drive", ("It turned.",))]) is None
    assert measure_thesis_agreement([]) is None
    assert "numbers of the thesis" not in render_trials_page([ExperimentSheet("drive", "A drive", ("It turned.",))])


values = st.one_of(st.none(), st.floats(-100, 100))


@given(st.lists(st.tuples(values, values), min_size=1, max_size=30))
def test_every_printed_number_is_counted_once(pairs: list[tuple[float | None, float | None]]) -> None:
    rows = tuple(ThesisComparison("e", "q", "m", thesis, ours) for thesis, ours in pairs)
    verdict = measure_thesis_agreement([ExperimentSheet("s", "S", (), rows)])
    printed = sum(thesis is not None for thesis, _ in pairs)
    if not printed:
        assert verdict is None
        return
    whole, *parts = map(int, verdict.table.rows[0][1:])
    assert whole == sum(parts) == printed


def test_the_page_begins_with_the_verdict() -> None:
    page = render_trials_page([SHEET, OTHER])
    assert page.index("5 of 7 numbers of the thesis are reproduced") < page.index("<h2>Circles (Table 1)</h2>")
    assert page.index("<td>Fixed</td>".replace("<td>", '<td class="words">')) < page.index("<h2>Circles")


@pytest.mark.parametrize("width", [24, 40, 60, 80, 120, 200])
def test_tables_cut_no_figure(width: int) -> None:
    table = TextTable("Radii", ("Steering", *(f"Model {k}" for k in range(6))), (
        ("25 degrees", *(f"{1234.567 + k:.3f} m" for k in range(6))),
    ))  # fmt: skip
    sheet = ExperimentSheet("a", "Circles", ("Words.",), NUMBERS, (), (table,))
    text = print_text(build_trials_table([sheet]), width)
    assert max(map(len, text.splitlines())) <= width
    for figure in (*(f"{1234.567 + k:.3f} m" for k in range(6)), "10.5 m", "8.4 m", "+5.1 %", "-15.0 %", "-16.0 %"):
        assert re.search(rf"(?<![\d.+-]){re.escape(figure)}( |$)", text, flags=re.M), figure
