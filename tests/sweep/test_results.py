"""What a sweep says of its plans: the front against brute force, influences against closed forms, tables and pages."""

import json
import re
import sys
from dataclasses import replace
from io import BytesIO

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import reports.sweep.report  # noqa: F401
from planner.cli.sweep import pick_plan
from planner.errors import RequestError
from reports.common.drawing_sizes import ChartAxis
from reports.common.rendering import ReportError
from reports.sweep.report import (
    build_sweep_screen,
    format_sweep_csv,
    format_sweep_json,
    render_sweep_page,
    render_sweep_parquet,
    render_sweep_png,
)
from reports.sweep.results import build_command, compare_with_drive, find_front, measure_influences
from tests.printing import print_text
from tests.sweep.results import build_result

AIMS = arrays(np.float64, st.tuples(st.integers(0, 30), st.integers(1, 4)), elements=st.integers(0, 4).map(float))


@given(AIMS)
def test_the_front_is_what_brute_force_finds(aims: np.ndarray) -> None:
    kept = find_front(aims)
    beaten = [
        any((other <= row).all() and (other < row).any() for other in aims)
        or any((other == row).all() for other in aims[:number])
        for number, row in enumerate(aims)
    ]
    assert sorted(kept) == [number for number, is_beaten in enumerate(beaten) if not is_beaten]
    assert [tuple(aims[number]) for number in kept] == sorted(tuple(aims[number]) for number in kept)


@given(
    arrays(np.float64, st.integers(1, 6), elements=st.floats(-10, 10)),
    arrays(np.float64, st.integers(1, 6), elements=st.floats(-10, 10)),
)
def test_influences_of_a_sum_are_the_shares_of_its_variances(first: np.ndarray, second: np.ndarray) -> None:
    values = (first[:, None] + second[None, :]).ravel()
    groups = np.repeat(np.arange(len(first)), len(second)), np.tile(np.arange(len(second)), len(first))
    shares = measure_influences(values, np.column_stack(groups).astype(np.int64)).tolist()
    total = first.var() + second.var()
    if total > 1e-6:
        assert shares == pytest.approx([first.var() / total, second.var() / total], abs=1e-6)


def test_what_only_combinations_explain_is_nobodys() -> None:
    values, numbers = np.array([1.0, -1.0, -1.0, 1.0]), np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    assert measure_influences(values, numbers).tolist() == pytest.approx([0.0, 0.0])
    assert measure_influences(np.ones(4), numbers).tolist() == [0.0, 0.0]


def test_influences_add_up_where_combinations_have_no_plan() -> None:
    """Two options whose effects add up, of which five of nine combinations are there."""
    numbers = np.array([[0, 0], [0, 1], [0, 2], [1, 0], [2, 0]])
    values = numbers @ np.array([3.0, 1.0])
    shares = measure_influences(values, numbers)
    assert shares.sum() == pytest.approx(1.0)
    assert shares[0] > shares[1] > 0.0


def test_the_screen_says_what_to_take_what_matters_and_what_has_no_plan() -> None:
    text = " ".join(print_text(build_sweep_screen(build_result()), 100).split())
    assert "my field, 3.92 ha: 12 combinations" in text
    assert "6 m, 1 tractor, price per hour 40: 1 h 40 min, 72 EUR; estimated." in text
    assert "Of the difference in time: tractors 52 %, working width 45 %" in text and "in cost: working width" in text
    assert "2 combinations have no plan, the first: There is no work for 3." in text
    assert "9 of 10 plans driven in full lie within ± %" in text
    assert "assumed" not in text and "Cost EUR" in text
    assumed = " ".join(print_text(build_sweep_screen(replace(build_result(), is_priced=False)), 100).split())
    assert "33 min, 82 EUR (assumed prices); estimated." in assumed, "as headland plan says it"
    assert re.search(r"40 0:33:20 (\d+\.\d+) 25 99.0", text), "the row of three tractors is told to be uncertain"


def test_what_lacks_something_is_nowhere_called_the_one_to_take() -> None:
    late = tuple(replace(one, plan=replace(one.plan, meets_deadline=False)) for one in build_result().plans)
    result = replace(build_result(), plans=late, allowed_s=60.0)
    screen, page = print_text(build_sweep_screen(result), 200), render_sweep_page(result)
    for text in (screen, page):
        assert (
            "No combination does all that was asked for; the nearest is" in text and "It is not done in time." in text
        )
        assert "comes nearest to what was asked for." in text
        assert "the one to take" not in text and "no other beats" not in text.lower()
    assert "The shaded one is the one to take." in render_sweep_page(build_result())


def test_rows_are_the_front_with_the_best_and_can_be_picked() -> None:
    result = build_result()
    rows = result.rows
    assert result.best in rows and [pick_plan(result, number + 1) for number in range(len(rows))] == list(rows)
    assert pick_plan(result, None) is result.best
    for row in (0, len(rows) + 1):
        with pytest.raises(RequestError, match=rf"--pick is {row}; the table has rows 1 to {len(rows)}"):
            pick_plan(result, row)


def test_a_drive_that_is_the_estimate_differs_by_nothing() -> None:
    result = build_result()
    one = result.plans[0]
    driven = replace(one.plan, finished_s=one.plan.finished_s + 1e-3, worked_pct=99.01)
    text = compare_with_drive(result, one, driven)
    assert "(+0.0 %)" in text and "-0.0" not in text


def test_a_command_plans_the_combination() -> None:
    result = build_result()
    assert build_command(result, result.plans[2]) == (
        "headland plan --margin 1 'my field.geojson' --width 3 --tractors 2 --price-per-hour 40"
    )


def test_json_and_csv_have_all_plans() -> None:
    result = build_result()
    data = json.loads(format_sweep_json(result))
    assert result.best is not None
    assert (data["combinations"], data["done"], data["estimated"]) == (12, 12, True)
    assert data["without_plan"] == {"count": 2, "reason": "There is no work for 3."}
    assert data["currency"] == "EUR" and not data["prices_assumed"]
    assert len(data["plans"]) == 12 and data["best"]["command"] == build_command(result, result.best)
    assert [one["uncertainty_pct"] for one in data["plans"] if one["tractors"] == 3 and one["feasible"]] == [25.0, 25.0]
    lines = format_sweep_csv(result).splitlines()
    assert len(lines) == 13 and lines[0].startswith("width_m,tractors,price_per_hour,finished_s")


def test_one_combination_is_told_of_as_one() -> None:
    one = replace(build_result(done=1), total=1)
    assert "my field, 3.92 ha: 1 combination" in print_text(build_sweep_screen(one), 100)
    assert "1 combinations" not in print_text(build_sweep_screen(one), 100)


def test_an_unfinished_sweep_says_so() -> None:
    assert "my field, 3.92 ha: 5 of 12 combinations" in print_text(build_sweep_screen(build_result(done=5)), 100)


def test_without_a_plan_nothing_is_drawn_and_the_page_says_why() -> None:
    result = build_result()
    refused = build_result(done=0)
    assert "No combination has a plan." in render_sweep_page(refused)
    with pytest.raises(ReportError, match="No combination has a plan"):
        render_sweep_png(refused)
    assert render_sweep_png(result).startswith(b"\x89PNG")


def test_a_notebook_shows_it() -> None:
    result = build_result()
    assert "12 combinations" in repr(result) and "data:image/png" in result._repr_html_()
    assert len(result.to_pandas()) == 12


@settings(max_examples=50)
@given(st.floats(-1e6, 1e6), st.floats(0.1, 1e6))
def test_ticks_lie_within_the_axis(low: float, span: float) -> None:
    axis = ChartAxis(low, low + span, 10.0, 500.0)
    ticks = axis.list_ticks()
    assert len(ticks) <= 8 and all(9.9 <= place <= 500.1 for place, _ in ticks)


def test_parquet_has_all_plans() -> None:
    pytest.importorskip("pyarrow")
    assert len(pd.read_parquet(BytesIO(render_sweep_parquet(build_result())))) == 12


def test_without_pyarrow_a_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ReportError, match=r"^Parquet needs pyarrow.*; install headland\[parquet\], or write CSV\.$"):
        render_sweep_parquet(build_result())
