"""What the coverage benchmark reads and counts."""

import json
from pathlib import Path
from typing import Any

import pytest

from planner.request.plan_request import PlanRequest
from reports.common.plan_results import PlanResult
from tests.benchmarks.coverage import Row, found, totals

SQUARE = [[10.0, 56.0], [10.002, 56.0], [10.002, 56.001], [10.0, 56.001], [10.0, 56.0]]


def result(strategy: str, tractors: int, worked: float | None, seconds: float = 100.0) -> PlanResult:
    if worked is None:
        return PlanResult(strategy, tractors, "auto", False, "too short for 3 tractors")
    return PlanResult(strategy, tractors, "auto", True, worked_pct=worked, finished_s=seconds, time_s=seconds)


def test_outlines_in_wkt_are_read_beside_geojson(tmp_path: Path, capsys: Any) -> None:
    """The same outline in either form is the same field; what cannot be read is named."""
    (tmp_path / "a.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [SQUARE]}))
    (tmp_path / "b.wkt").write_text(f"POLYGON (({', '.join(f'{x} {y}' for x, y in SQUARE)}))")
    (tmp_path / "c.json").write_text("no JSON")
    (tmp_path / "d.json").write_text(json.dumps({"type": "Polygon", "coordinates": [[*SQUARE[:2], SQUARE[0]]]}))
    (one, first), (two, second) = found(tmp_path)
    assert (one, two) == ("a", "b") and first.area_ha == pytest.approx(second.area_ha, rel=1e-6)
    told = capsys.readouterr().out
    assert "c.json: not read" in told and "d.json: not read" in told


def test_totals_count_parcels_and_not_plans() -> None:
    """Of two parcels one has no col-by-col for two; the one without a plan counts as worked not at all."""
    scenario = PlanRequest(tractors=(1, 2), strategies=("col-by-col", "split-field"))
    good = (result("split-field", 1, 97.0, 200.0), result("split-field", 2, 99.0), result("col-by-col", 2, 98.0, 150.0))
    bad = (result("split-field", 2, 96.0), result("col-by-col", 2, None))
    rows = [Row("good", 2.0, good), Row("bad", 1.0, bad), Row("none", 1.0, (result("split-field", 2, None),))]
    told = "\n".join(totals(rows, scenario))
    assert rows[0].quickest == good[1] and rows[2].quickest is None
    assert "parcels: 3; with a plan: 2" in told and "median 96.00 %" in told and "on 2 of 3 parcels" in told
    assert "col-by-col: feasible on 1 of 3 (33 %) for 2" in told and "split-field: feasible on 2 of 3" in told
    assert "plans: 4 of 6 feasible" in told and "2 too short for tractors" in told
