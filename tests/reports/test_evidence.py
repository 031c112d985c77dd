"""Evidence of a diagnosis: paths, errors by time, speed, angle and place, correlations, and limits of plots."""

import json
from dataclasses import replace

import numpy as np
import pytest

from reports.common.wording import get_effect_label
from reports.diagnosis.evidence import build_curve_drawing, build_evidence_content
from reports.diagnosis.page import render_diagnosis_page
from reports.diagnosis.tables import format_diagnosis_json
from tests.reports.test_diagnosis import diagnosis, page_text
from vehicle.identification.diagnosis.results import (
    ParameterCorrelations,
    PathPair,
    PieceErrors,
    PlaceErrors,
    ReplayEvidence,
    ResidualPlot,
)


def pieces(seed: int, count: int) -> PieceErrors:
    rng = np.random.default_rng(seed)
    edges = np.arange(count + 1.0)
    return PieceErrors(edges[:-1], edges[1:], np.full(count, 50.0), *rng.uniform(0.5, 9.0, (4, count)))


def evidence() -> ReplayEvidence:
    time = np.arange(0.0, 8.0)
    straight = np.column_stack([2.0 * time, 0.0 * time])
    bent = straight + np.column_stack([0.0 * time, 0.1 * time**2])
    places = PlaceErrors(np.array([0.0, 5.0]), np.array([0.0, 0.0]), 5.0, np.array([8.0, 2.0]), np.array([1.0, 1.0]))
    paths = (PathPair("first", time, straight, straight, straight), PathPair("second", time, straight, bent, straight))
    return ReplayEvidence(10.0, pieces(1, 4), pieces(2, 6), pieces(3, 9), places, paths)


class TestEvidence:
    def test_bars_have_the_heights_of_the_errors(self) -> None:
        content = build_evidence_content(diagnosis(evidence=evidence()))
        assert [chart["kind"] for chart in content["charts"]] == 3 * ["cross"] + 3 * ["along"]
        by_speed, errors = content["charts"][1], evidence().by_speed
        heights = [float(bar["height"]) for bar in by_speed["bars"]]
        values = np.column_stack([errors.cross_before_cm, errors.cross_after_cm]).ravel()
        assert len(heights) == 2 * 6
        assert heights == pytest.approx(values * heights[0] / values[0], abs=0.2)
        assert [float(bar["value"]) for bar in by_speed["bars"]] == pytest.approx(values, abs=1e-3)

    def test_a_chart_without_a_bin_and_along_where_it_is_not_judged_are_left_out(self) -> None:
        short = diagnosis(evidence=replace(evidence(), by_speed=pieces(2, 0)), along_judged=False)
        assert [chart["kind"] for chart in build_evidence_content(short)["charts"]] == ["cross", "cross"]
        assert "by wheel angle" in render_diagnosis_page(short)

    def test_the_path_that_gains_most_is_shown_first(self) -> None:
        page = render_diagnosis_page(diagnosis(evidence=evidence()))
        assert '<option value="1" selected>second, 7 s</option>' in page
        assert "<script>" not in render_diagnosis_page(diagnosis())

    def test_json_has_the_same_errors_as_the_bars(self) -> None:
        found = json.loads(format_diagnosis_json(diagnosis(evidence=evidence())))["residuals"]
        keys = ("over_time_s", "by_speed_mps", "by_angle_deg", "by_place_m")
        assert [len(found[key]) for key in keys] == [4, 6, 9, 2]
        assert [one["along_after_cm"] for one in found["by_angle_deg"]] == evidence().by_angle.along_after_cm.tolist()
        assert found["by_place_m"][0] == {"west": 0.0, "south": 0.0, "side": 5.0, "before_cm": 8.0, "after_cm": 1.0}

    def test_slopes_are_drawn_and_the_error_is_split_by_them(self) -> None:
        edges = np.arange(0.0, 20.0, 5.0)
        places = PlaceErrors(edges, 0.0 * edges, 5.0, np.array([1.0, 1.0, 3.0, 4.0]), np.ones(4))
        level = replace(evidence(), by_place=places)
        assert "Slope of the ground" not in render_diagnosis_page(diagnosis(evidence=level))
        known = replace(level, by_place=replace(places, slopes=np.array([0.01, 0.02, 0.06, 0.10])))
        page = render_diagnosis_page(diagnosis(evidence=known))
        assert "Slope of the ground" in page and "a slope of 9.4 % or more" in page
        assert page.count("slope 10.0 %") == 1 and 'fill-opacity="0.64"' in page
        split = "steeper than 4.0 % the error is 3.5 cm before and 1.0 cm after, on the others 1.0 cm and 1.0 cm."
        assert split in page
        found = json.loads(format_diagnosis_json(diagnosis(evidence=known)))["residuals"]["by_place_m"]
        assert [one["slope_pct"] for one in found] == pytest.approx([1.0, 2.0, 6.0, 10.0])

    def test_correlations_are_paired_and_named(self) -> None:
        names = (("understeer", "deg_per_mps2"), ("cross_slope_drift", "ratio"), ("cross_slope_drift", "bearing_deg"))
        matrix = np.array([[1.0, -0.95, 0.2], [-0.95, 1.0, 0.1], [0.2, 0.1, 1.0]])
        what = diagnosis(correlations=ParameterCorrelations(names, matrix))
        found = json.loads(format_diagnosis_json(what))["correlations"]
        assert found[0] == {"values": ["understeer.deg_per_mps2", "cross_slope_drift.ratio"], "correlation": -0.95}
        assert [one["correlation"] for one in found] == [-0.95, 0.2, 0.1]
        assert f"Hardly told apart: understeer and {get_effect_label('cross_slope_drift')}, ratio." in page_text(what)

    def test_the_plot_of_a_limit_reaches_the_limit(self) -> None:
        at = np.array([-0.5, 0.0, 0.5])
        drawn = build_curve_drawing(ResidualPlot("lateral", "turning", at, at, at, at, at, limit=0.75))
        assert [text for _, text in drawn["limits"]] == ["0.75", "0.75"]
        assert [x for x, _ in drawn["limits"]] == pytest.approx([drawn["frame"].left, drawn["frame"].right])
        one_side = build_curve_drawing(ResidualPlot("speed", "turning", at + 0.5, at, at, at, at, limit=2.0))
        assert len(one_side["limits"]) == 1 and one_side["series"][0]["points"][-1]["x"] < one_side["limits"][0][0]
