"""Files as they come in the first hour: shared ids, swapped axes, and an outline that is rough and crosses itself."""

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from tests.cli.conftest import Run
from tests.cli.refusals import assert_refused
from tests.drawn_fields import feature, rectangle, ring, write_features

pytestmark = pytest.mark.usefixtures("first_layout")

ONE = ("--tractors", "1", "--strategies", "split-field", "--processes", "1")


@pytest.mark.slow
def test_fields_that_share_an_id_are_all_planned(headland: Run, tmp_path: Path) -> None:
    squares = [feature(rectangle(x, 0, 40, 30), id=key) for x, key in ((0, 2), (100, 2), (200, 1))]
    file = write_features(tmp_path / "farm.geojson", *squares)
    outcome = headland("plan", f"{file}#*", "--local", *ONE, "--no-headland", "--csv")
    assert outcome.status == 0
    rows = list(csv.DictReader(io.StringIO(outcome.out)))
    assert [row["requested_field"].rpartition("#")[2] for row in rows] == ["2-1", "2-2", "1"]
    assert outcome.err.count("got a number: '2-1', '2-2'.") == 1


def test_swapped_axes_are_refused_and_the_advice_helps(headland: Run, tmp_path: Path) -> None:
    west, south, side = 9.5, 56.0, 0.002
    corners = [(west, south), (west + side, south), (west + side, south + side), (west, south + side)]
    file = write_features(tmp_path / "farm.geojson", feature(ring(*[(y, x) for x, y in corners])))
    assert_refused(
        headland("plan", file, *ONE), "lies at latitude 9.50, longitude 56.00", "lies on land: add --swap-axes."
    )
    assert headland("field", file, "--swap-axes", "--json").status == 0
    write_features(tmp_path / "farm.geojson", feature(ring(*corners)))
    assert_refused(headland("plan", file, *ONE, "--swap-axes"), "leave out --swap-axes.")


@pytest.mark.slow
def test_a_rough_outline_is_cleaned_and_planned(headland: Run, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    outline = shapely.LinearRing([(0, 0), (75, 0), (75, 50), (0, 50)])
    places = shapely.line_interpolate_point(outline, np.linspace(0.0, outline.length, 2_000, endpoint=False))
    rough = (shapely.get_coordinates(places) + rng.normal(0.0, 0.3, (2_000, 2))).tolist()
    file = write_features(tmp_path / "farm.geojson", feature(ring(*rough[:700], (40, 75), *rough[699:])))
    outcome = headland("plan", file, "--local", *ONE, "--json")
    assert outcome.status == 0 and "of its 2002 points remain" in outcome.err
    (plan,) = json.loads(outcome.out)["plans"]
    assert plan["worked_pct"] > 95.0
