"""Cells of a table as numbers."""

import numpy as np
import pandas as pd
import pytest

from tests.identification.log_tables import refusal
from vehicle.identification.logs.table import extract_columns

HEAD = ("time_s", "easting_m", "northing_m", "steering_deg")


def test_cells_are_numbers_or_missing() -> None:
    frame = pd.DataFrame([["0", " 1.5 ", "2e1", "-3"], ["1", "", "NaN", "n/a"]], columns=list(HEAD)).assign(rpm="1800")
    columns, others = extract_columns(frame, "run")
    assert others == ("rpm",) and set(columns) == set(HEAD)
    assert columns["easting_m"][0] == 1.5 and columns["northing_m"][0] == 20.0
    assert all(np.isnan(columns[name][1]) for name in HEAD[1:])


def test_a_column_without_a_number_counts_as_absent() -> None:
    frame = pd.DataFrame([["0", "1", "2", "3", ""], ["1", "1", "2", "3", ""]], columns=[*HEAD, "heading_deg"])
    assert "heading_deg" not in extract_columns(frame, "run")[0]


@pytest.mark.parametrize("column", HEAD)
def test_what_is_needed_is_named(column: str) -> None:
    frame = pd.DataFrame([["0", "1", "2", "3"]] * 2, columns=list(HEAD)).drop(columns=column)
    assert column in refusal(lambda: extract_columns(frame, "run"))
