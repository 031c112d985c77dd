"""Results in a notebook: short in text, small and escaped as HTML, and the same figures as their files."""

import csv
import io
import json
import re
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import reports.diagnosis.page
import reports.plan.notebook  # noqa: F401
from planner.pipeline.diagnosis import TractorDiagnosis
from reports.common.plan_records import PlanDrive
from reports.common.plan_results import PlanRanking
from reports.common.rendering import PICTURE_DPIS, ReportError, ShownResult, encode_picture
from reports.diagnosis.tables import build_diagnosis_dict
from reports.plan.figures import format_ranking_csv, format_ranking_json
from reports.trials.report import FleetStudy
from tests.reports.test_diagnosis import diagnosis, in_model
from vehicle.identification.diagnosis.results import NAMED

MOST_REPR_CHARS, MOST_HTML_BYTES = 300, 300_000
EVIL = "<script>alert('&')</script>"


class _Tags(HTMLParser):
    """Tags that are open, and all that were met."""

    def __init__(self) -> None:
        super().__init__()
        self.open, self.met = list[str](), set[str]()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.met.add(tag)
        if tag != "img":
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def check_shown(result: ShownResult) -> str:
    """The HTML of a result that is short in text, and small and well formed as HTML."""
    text, html = repr(result), result._repr_html_()
    assert len(text) < MOST_REPR_CHARS and "\n" not in text and text.startswith(f"<{type(result).__name__}: ")
    assert len(html.encode()) < MOST_HTML_BYTES
    tags = _Tags()
    tags.feed(html)
    assert tags.open == [] and "script" not in tags.met and tags.met >= {"div", "p"}
    return html


def as_cell(text: str) -> Any:
    """A cell of a CSV as a value."""
    if text in ("", "true", "false"):
        return {"": None, "true": True, "false": False}[text]
    return float(text) if re.fullmatch(r"-?\d+(\.\d+)?(e-?\d+)?", text) else text


def as_plain(value: Any) -> Any:
    """A value of a data frame as a plain one; None where it is missing."""
    return None if value is None or value != value else value.item() if isinstance(value, np.generic) else value


def test_a_ranking_is_shown_and_goes_to_pandas_as_its_csv(ranking: PlanRanking, leaving: PlanRanking) -> None:
    for one in (ranking, leaving, replace(ranking, plans=ranking.plans[6:]), replace(ranking, plans=())):
        assert ranking.field_name in check_shown(one)
        rows = list(csv.reader(io.StringIO(format_ranking_csv(one))))
        frame = one.to_pandas()
        assert list(frame.columns) == rows[0] and len(frame) == len(one.plans)
        for row, found in zip(rows[1:], frame.itertuples(index=False), strict=True):
            assert [as_plain(value) for value in found] == [as_cell(text) for text in row]


def test_each_plan_of_a_ranking_is_shown(ranking: PlanRanking) -> None:
    for plan in ranking.plans:
        html = check_shown(plan)
        assert (plan.strategy in repr(plan)) == (plan.tractors > 1), "of one it says nothing"
        assert f'<td style="text-align: right">{plan.strategy}</td>' in html
        assert plan.to_pandas()["strategy"].tolist() == [plan.strategy]
    with pytest.raises(ReportError, match="one row of a ranking"):
        ranking.plans[0].plot()


@pytest.mark.parametrize("name", [EVIL, "x" * 5000, "a\nb\0c", "$\\frac{1}{2$", "北の畑", ""])
def test_names_are_escaped_and_shortened(ranking: PlanRanking, drive: PlanDrive, name: str) -> None:
    html = check_shown(replace(ranking, field_name=name, plans=ranking.plans[:2]))
    assert EVIL not in html and ("&lt;script&gt;" in html) == (name == EVIL)
    check_shown(replace(drive, title=name))
    plan = replace(ranking.plans[0], strategy=name, remarks=(name,))
    assert EVIL not in check_shown(plan)


@pytest.mark.slow
def test_a_map_has_many_lines_and_is_small_all_the_same(drive: PlanDrive) -> None:
    generator = np.random.default_rng(1)
    xy = tuple(generator.uniform((0.0, 0.0), (270.0, 70.0), (6_000, 2)) for _ in drive.xy)
    status = tuple(np.repeat(generator.integers(1, 5, len(path) // 20), 20) for path in xy)
    check_shown(replace(drive, xy=xy, status=status))

    def draw_noise(axes: Axes) -> None:
        axes.imshow(generator.random((900, 900, 3)))

    assert len(encode_picture(draw_noise)) < MOST_HTML_BYTES
    assert list(PICTURE_DPIS) == sorted(PICTURE_DPIS, reverse=True)


def test_drawings_go_on_given_axes_and_open_no_window(ranking: PlanRanking, drive: PlanDrive) -> None:
    from matplotlib import pyplot

    before, given = pyplot.get_fignums(), Figure().add_subplot()
    for result in (ranking, drive, TractorDiagnosis(**vars(diagnosis()))):
        assert result.plot(ax=given) is given and isinstance(result.plot(), Axes)
    assert pyplot.get_fignums() == before
    with pytest.raises(ReportError, match="no plan works"):
        replace(ranking, plans=ranking.plans[6:]).plot()


def test_a_notebook_shows_the_figure_below_the_cell(drive: PlanDrive, monkeypatch: pytest.MonkeyPatch) -> None:
    from matplotlib import pyplot

    monkeypatch.setitem(sys.modules, "ipykernel", sys)
    before = set(pyplot.get_fignums())
    drive.plot()
    opened = set(pyplot.get_fignums()) - before
    assert len(opened) == 1
    pyplot.close(opened.pop())


def test_a_diagnosis_has_a_row_per_effect_as_its_json() -> None:
    found = TractorDiagnosis(**vars(diagnosis(in_model("steering_offset", NAMED, 1.25))))
    html, frame, effects = check_shown(found), found.to_pandas(), build_diagnosis_dict(found)["effects"]
    assert "steering offset" in html and len(frame) == len(effects)
    for (_, row), effect in zip(frame.iterrows(), effects, strict=True):
        assert (row["id"], row["status"], row["unit"]) == (effect["id"], effect["status"], effect["unit"])
        assert as_plain(row["value"]) == (effect["value"] and next(iter(effect["value"].values())))
        assert as_plain(row["smallest_visible"]) == effect["smallest_visible"]
    named = frame[frame["status"] == NAMED].iloc[0]
    assert (named["value"], named["value_low"], named["value_high"]) == pytest.approx((1.25, 1.125, 1.375))


def test_a_study_has_a_row_per_printed_time(study: FleetStudy) -> None:
    frame = study.to_pandas()
    assert check_shown(study) and len(frame) == sum(map(len, study.tables.values()))
    assert frame["thesis_s"].tolist() == [row.thesis_s for rows in study.tables.values() for row in rows]
    assert isinstance(study.plot(), Axes)


def test_files_are_written_by_their_endings(ranking: PlanRanking, tmp_path: Path) -> None:
    assert json.loads(ranking.save(tmp_path / "a.JSON").read_text()) == json.loads(format_ranking_json(ranking))
    assert ranking.save(str(tmp_path / "a.csv")).read_text() == format_ranking_csv(ranking)
    assert "<html" in ranking.save(tmp_path / "a.html").read_text()
    for name in ("a.xlsx", "a", ".json"):
        with pytest.raises(ReportError, match=r"ends in \.csv or \.json or \.html"):
            ranking.save(tmp_path / name)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.JSON", "a.csv", "a.html"]
