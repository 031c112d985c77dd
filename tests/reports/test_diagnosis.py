"""A diagnosis in words, as table, page and JSON: every case is said as it is."""

import json
import math
import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reports.common.drawing_sizes import ChartAxis
from reports.diagnosis.page import render_diagnosis_page
from reports.diagnosis.sentences import LIKELY_MEANS, explain_likely_verdict
from reports.diagnosis.tables import build_diagnosis_table, format_diagnosis_json
from tests.printing import print_text
from vehicle.identification.diagnosis.demo_logs import HiddenEffect
from vehicle.identification.diagnosis.results import (
    EQUIVALENT,
    LIKELY,
    NAMED,
    NOT_VISIBLE,
    REFUTED,
    Diagnosis,
    Finding,
    Hint,
    NextDrive,
    PlanGain,
    ResidualPlot,
)
from vehicle.identification.replay.horizon_errors import HorizonError
from vehicle.model.effects import CATALOGUE, get_effect
from vehicle.model.tractor import DiscrepancyModel, EffectSetting, load_tractor

DISCREPANCY = DiscrepancyModel(
    amounts={"angle_by_speed": 0.4, "grip_to_east": 0.05, "grip_to_north": -0.02}, speed_mps=(0.2, 2.1),
    angle_deg=(-20.0, 25.5), interval={"angle_by_speed": (0.3, 0.5)},
)  # fmt: skip
PLAN = PlanGain("iwamizawa", 4938.0, 4962.0, 2.31, 20.14)
WRONG = {h: HorizonError(h, 2.0 * h, 0.1 * h) for h in (1.0, 5.0)}
HINT = Hint("the wheel angle", "heading", None, "Errors of the headings go together with the wheel angle.")
GETS_OFFSET = "The tractor file gets: steering offset (steering_offset)."
BEFORE, AFTER = "Simulated with the old file: ", "Simulated as these logs say the tractor drives: "


def finding(name: str, status: str = REFUTED, **more: Any) -> Finding:
    return Finding(name, status, **({"smallest_visible": 0.125} | more))


def in_model(name: str, status: str, value: float, **more: Any) -> Finding:
    entry, key = get_effect(name), get_effect(name).size.name
    values: dict[str, Any] = {
        "value": {key: value}, "interval": {key: (0.9 * value, 1.1 * value)}, "gain_pct": 40.4,
        "gain_interval": (30.2, 50.7), "description": entry.describe({key: value}),
    }  # fmt: skip
    return finding(name, status, **(values | more))


def diagnosis(*told: Finding, **more: Any) -> Diagnosis:
    """A diagnosis in which what is not told is refuted."""
    by_id = {one.id: one for one in told}
    errors = {h: HorizonError(h, 2.0 * h, 0.1 * h) for h in (1.0, 5.0)}
    half = {h: HorizonError(0.5 * h, h, 0.05 * h) for h in (1.0, 5.0)}
    at = np.array([-1.0, 0.0, 2.0])
    values: dict[str, Any] = {
        "names": ("a", "b"), "rows_used": 2000, "rows_gated": 3, "minutes": 1.7, "ground": "soil", "before": errors,
        "after": half, "noise_floor": half, "guilty_block": None, "block_error": {"speed": (1.5, 1.0)},
        "findings": tuple(by_id.get(entry.id) or finding(entry.id) for entry in CATALOGUE),
        "named": tuple(one.id for one in told if one.status == NAMED), "unexplained_share": 0.0, "depends_on": (),
        "next_drive": None, "tractor": load_tractor("eg105"), "calibration": {},
        "curve": ResidualPlot("wheel angle, deg", "remaining turning rate, deg/s", at, at, 0 * at, 0 * at, 0 * at),
    }  # fmt: skip
    return Diagnosis(**(values | more))


def extended(rest: DiscrepancyModel | None = None, **settings: EffectSetting) -> Any:
    return load_tractor("eg105").model_copy(update={"effects": settings, "discrepancy_model": rest})


def setting(**more: Any) -> EffectSetting:
    return EffectSetting(value={"angle_deg": 1.0}, **more)


def printed(what: Diagnosis, width: int = 80) -> str:
    return print_text(build_diagnosis_table(what), width)


def flat(text: str) -> str:
    return " ".join(text.split())


def page_text(what: Diagnosis, hidden: str | None = None) -> str:
    """The words of the page in the order a reader meets them."""
    body = render_diagnosis_page(what, hidden).split("</style>")[1]
    return flat(unescape(re.sub(r"<[^>]+>", " ", body)))


def both(what: Diagnosis) -> list[str]:
    return [flat(printed(what, 100)), page_text(what)]


OFFSET = in_model("steering_offset", NAMED, 1.0)
CHANGED = extended(steering_offset=setting())
ALIKE = in_model("steering_offset", EQUIVALENT, 1.0, equivalent_to=("heading_bias",))
SURE = (
    in_model("steering_gain", NAMED, 1.1), in_model("steering_offset", EQUIVALENT, 1.0),
    in_model("grip_drift", LIKELY, 0.05), finding("side_slip", NOT_VISIBLE),
)  # fmt: skip
SAVED = extended(
    side_slip=EffectSetting(value={"limit_g": 0.5}), steering_gain=EffectSetting(value={"ratio": 1.1}),
    steering_offset=setting(named=False, equivalent_to=("cross_slope_drift", "heading_bias")),
    grip_drift=EffectSetting(value={"per_minute": 0.05}, named=False),
)  # fmt: skip
SAID: dict[str, tuple[Diagnosis, tuple[str, ...], tuple[str, ...]]] = {
    "nothing added": (diagnosis(), ("Nothing was added to the tractor, so plans do not change.",), ("That holds",)),
    "added and driven": (
        diagnosis(OFFSET, plan=PLAN, tractor=CHANGED),
        (GETS_OFFSET, f"{BEFORE}82.3 min, 2.3 cm off the tracks", f"{AFTER}82.7 min, 20.1 cm off the tracks"),
        ("Nothing was added", "That holds", "not finished"),
    ),
    "not finished after": (
        diagnosis(OFFSET, plan=replace(PLAN, time_after_s=None), tractor=CHANGED), (f"{AFTER}not finished",),
        (f"{BEFORE}not finished", "Nothing was added"),
    ),
    "not finished before": (
        diagnosis(OFFSET, plan=replace(PLAN, time_before_s=None), tractor=CHANGED), (f"{BEFORE}not finished",),
        (f"{AFTER}not finished", "Nothing was added"),
    ),
    "never finished": (
        diagnosis(OFFSET, plan=replace(PLAN, time_before_s=None, time_after_s=None), tractor=CHANGED),
        (f"{BEFORE}not finished", f"{AFTER}not finished"), ("Nothing was added",),
    ),
    "added but not driven": (
        diagnosis(OFFSET, tractor=CHANGED, notes=("No plan was driven to compare: too small.",)),
        (GETS_OFFSET, "No plan was driven to compare"), ("Nothing was added", "min,"),
    ),
    "taken away": (diagnosis(plan=PLAN), ("The effects in the tractor file are removed.", "82.7 min"), ()),
    "driven with one of several causes": (
        diagnosis(ALIKE, plan=PLAN, tractor=extended(steering_offset=setting(named=False,
                                                                             equivalent_to=("heading_bias",)))),
        ("That holds if it is steering offset.",), (),
    ),
    "how sure each saved effect is": (
        diagnosis(*SURE, tractor=SAVED),
        ("The tractor file gets: side slip (side_slip), unchanged; steering gain (steering_gain); steering offset "
         "(steering_offset), or cross slope drift or heading bias in its place; grip drift (grip_drift), likely.",), (),
    ),
    "a discrepancy model": (
        diagnosis(tractor=extended(DISCREPANCY)),
        ("an extra wheel angle that depends on speed: 0.4 (0.3 to 0.5) deg per m/s",
         "a change of grip that depends on the direction of travel: 0.05 towards east and -0.02 towards north",
         "only where these logs were driven: 0.2 to 2.1 m/s and wheel angles of -20.0 to 25.5 degrees",
         'The line "on = false" under [discrepancy_model] in the tractor file switches it off.',
         "The tractor file gets: a discrepancy model."), (),
    ),
    "one of a kind": (
        diagnosis(names=("a",), rows_used=1, rows_gated=1),
        ("1 run, 1.7 minutes, 1 row used, 1 left out", "windows of 20 s"), ("1 runs", "1 rows"),
    ),
    "no more than noise": (
        diagnosis(depends_on=("a push",)),
        ("The remaining error over pieces of 5 s, 2.5 cm across (noise 2.5), 5.0 cm along (noise 5.0), 0.25 degrees "
         "(noise 0.25), is no more than noise.",), ("depends on: a push",),
    ),
    "above noise over long pieces": (
        diagnosis(above_noise_s=(10.0, 20.0), depends_on=("a push",)),
        ("is no more than noise, but above it over pieces of 10 and 20 s.",), ("depends on: a push",),
    ),
    "hardly above noise": (
        diagnosis(above_noise_s=(5.0,)), ("is hardly above the noise over pieces of 5 s.",), (),
    ),
    "a hint names a quantity": (
        diagnosis(unexplained_share=0.3, hints=(HINT,), after=WRONG, pace_mps=0.5),
        ("It depends on: the wheel angle.",), ("none of the quantities",),
    ),
    "the rest that was fitted is driven": (
        diagnosis(unexplained_share=0.4, pace_mps=1.0, tractor=extended(DISCREPANCY),
                  plan=replace(PLAN, discrepancy_s=12.4, discrepancy_cm=1.36)),
        ("the discrepancy model fitted to it changes the result by +12 s and +1.4 cm off the tracks",), (),
    ),
}  # fmt: skip
"""By what is the case: a diagnosis, and what table and page say of it and what not."""


@pytest.mark.parametrize("case", SAID)
def test_table_and_page_say_it_as_it_is(case: str) -> None:
    what, said, unsaid = SAID[case]
    for text in both(what):
        assert [part for part in said if part not in text] == [] == [part for part in unsaid if part in text]


class TestLikely:
    def test_stands_before_what_is_refuted_and_says_how_often_it_is_right(self) -> None:
        what = diagnosis(in_model("grip_drift", LIKELY, 0.05), finding("understeer", NOT_VISIBLE))
        status = re.compile(" (refuted|not-visible|likely) ")
        lines = [line for line in printed(what, 120).split("Smallest visible:")[0].splitlines() if status.search(line)]
        assert " likely " in lines[0] and "grip drift" in lines[0] and "0.05 (0.045" in lines[0]
        assert "not-visible" in lines[-1] and "understeer" in lines[-1]
        assert "refuted" not in lines[0] and len(lines) == len(CATALOGUE)
        rows = re.findall(r'<tr class="(.*?)"><td class="id">.*?<code>(.*?)</code></td>', render_diagnosis_page(what))
        assert rows[0] == ("likely", "grip_drift") and rows[-1] == ("not-visible", "understeer")
        assert all(explain_likely_verdict() in text for text in both(what))
        assert not any(LIKELY_MEANS in text for text in both(diagnosis()))
        assert what.headline.startswith("No cause is certain. Likely: ")

    def test_what_is_refuted_says_from_which_size_on_and_a_limit_up_to_which(self) -> None:
        what = diagnosis(finding("steering_offset", smallest_visible=0.3), finding("side_slip"))
        assert "refuted from 0.3 deg" in page_text(what) and "refuted to 0.12 g" in page_text(what)
        assert "Refuted effects are refuted from that size on." in flat(printed(what))

    def test_are_marked_in_json(self) -> None:
        told = (in_model("grip_drift", LIKELY, 0.05), in_model("steering_offset", NAMED, 1.0))
        found = json.loads(format_diagnosis_json(diagnosis(*told)))["effects"]
        assert {one["id"]: one["calibrated"] for one in found if one["value"]} == {
            "grip_drift": True, "steering_offset": False,
        }  # fmt: skip
        assert {one["status"] for one in found} == {NAMED, REFUTED, LIKELY}


class TestWords:
    def test_a_horizon_above_the_noise_is_told_to_programs(self) -> None:
        what = diagnosis(above_noise_s=(10.0, 20.0))
        left = json.loads(format_diagnosis_json(what))["residual_error"]
        assert not what.is_noise_only and left["above_noise_s"] == [10.0, 20.0]

    def test_the_way_along_is_not_called_noise_where_no_speed_was_measured(self) -> None:
        wrong = {h: HorizonError(h, 90.0 * h, 0.1 * h) for h in (1.0, 5.0)}
        for share in (0.0, 0.4):
            what = diagnosis(unexplained_share=share, after=wrong, pace_mps=0.5, along_judged=False)
            for text in both(what):
                assert "The error along the path is not judged, because not every log has a measured speed." in text
                assert "cm along (" not in text and "early or late" not in text
            left = json.loads(format_diagnosis_json(what))["residual_error"]
            assert left["late_s"] is None and left["aside_cm"] > 0.0

    @pytest.mark.parametrize(
        ("share", "depends", "said"),
        [
            (0.42, ("a push", "a pull"), "depends on: a push; a pull."),
            (0.3, (), "on: none of the quantities examined."),
        ],
    )
    def test_what_is_left_is_said_in_order(self, share: float, depends: tuple[str, ...], said: str) -> None:
        """Against the noise, then in a plan, then what it depends on: twice the noise over 5 s at 1 m/s."""
        what = diagnosis(unexplained_share=share, depends_on=depends, after=WRONG, pace_mps=0.5)
        assert what.residual_error.aside_cm == pytest.approx(2.5 * math.sqrt(3.0))
        assert what.residual_error.late_s == pytest.approx(0.1 * math.sqrt(3.0))
        for text in both(what):
            parts = f"explains {100 * share:.0f} % of", "within 5 s, that is 0.2 s early or late and 4.3 cm to the side"
            places = [text.index(part) for part in (*parts, said)]
            assert places == sorted(places)

    def test_errors_are_those_of_pieces_and_the_smallest_visible_is_a_deviation_or_a_limit(self) -> None:
        for text in both(diagnosis()):
            assert "root mean square" in text and "after 5 s" not in text
            assert "is aligned with" in text.replace("each aligned with", "each is aligned with")
            assert "the smallest change of the value in the tractor file" in text
            assert "limit 0.12 g" in text and text.count("limit 0.1") == 1

    def test_no_drive_without_need_and_competitors_with_their_drive(self) -> None:
        alike = in_model("steering_offset", EQUIVALENT, 1.0, exchange="1 deg looks like 0.017 of cross_slope_drift",
                         equivalent_to=("cross_slope_drift",))  # fmt: skip
        pair = ("steering_offset", "cross_slope_drift")
        drive = NextDrive("there-and-back", "Drive there and back.", 40.0, pair, 80.0)
        for text in both(diagnosis(alike, next_drive=drive)):
            assert "Steering offset: 1 deg looks like 0.017 of cross slope drift." in text
            assert "Drive there and back." in text
        for text in both(diagnosis(alike)):
            assert "1 deg looks like" in text and "Drive there and back." not in text
        assert "cannot distinguish" not in page_text(diagnosis())

    def test_stand_ins_have_no_gain(self) -> None:
        other = finding("heading_bias", EQUIVALENT, value={"angle_deg": 1.5}, equivalent_to=("steering_offset",))
        what = diagnosis(in_model("steering_offset", EQUIVALENT, 1.0), other)
        row = next(line for line in printed(what, 120).splitlines() if "heading_bias" in line)
        assert " ".join(row.split()) == "heading bias heading_bias equivalent 1.5 deg 0.12 deg"


class TestTable:
    @pytest.mark.parametrize("width", [80, 100])
    def test_no_id_and_no_status_is_cut(self, width: int) -> None:
        told = (in_model("steering_asymmetry", NAMED, 1.1), in_model("implement_side_draft", LIKELY, 0.0123))
        text = printed(diagnosis(*told), width)
        assert max(map(len, text.splitlines())) <= width and "…" not in text
        for entry in CATALOGUE:
            assert re.search(rf" {entry.id} +[a-z]", text)
        assert "likely" in text
        assert not any(entry.label == entry.id for entry in CATALOGUE if "_" in entry.id)

    @pytest.mark.parametrize("width", [40, 60, 80, 120, 200])
    def test_figures_are_whole_or_their_columns_are_named(self, width: int) -> None:
        told = in_model("steering_asymmetry", NAMED, 1.2345, gain_pct=40.4)
        text = printed(diagnosis(told), width)
        assert max(map(len, text.splitlines())) <= width
        missing = " ".join(re.findall("No room for: (.*?);", flat(text)))
        for heading, figures in (("Heading before", ("0.10", "0.50")), ("Along noise", ("1.0", "5.0"))):
            assert heading in missing or all(re.search(rf"(?<![\d.]){value}(?![\d.])", text) for value in figures)
        assert "Gain %" in missing or re.search(r" 40( |$)", text, flags=re.M)
        assert "Smallest visible" in missing or "limit 0.12 g" in flat(text)
        assert (missing == "") == (width >= 80)


class TestPage:
    @pytest.mark.parametrize("part", [0, 1])
    def test_what_is_not_visible_comes_with_the_drive_that_would_show_it(self, part: int) -> None:
        unseen = CATALOGUE[part::2]
        text = page_text(diagnosis(*(finding(entry.id, NOT_VISIBLE) for entry in unseen)))
        assert all(f"Drive to see it: {entry.drive}" in text and entry.regressor in text for entry in unseen)
        assert text.count("Drive to see it") == len(unseen)

    def test_what_is_likely_needs_no_drive(self) -> None:
        assert "Drive to see it" not in page_text(diagnosis(in_model("grip_drift", LIKELY, 0.05)))

    def test_the_curve_says_what_the_effect_goes_with(self) -> None:
        what = diagnosis(in_model("steering_gain", NAMED, 1.1))
        assert "The error from steering gain depends on: wheel angle." in page_text(what)
        assert "No known cause: a push." in page_text(diagnosis(depends_on=("a push",)))

    def test_bars_for_all_kinds_and_none_for_a_heading_that_was_not_logged(self) -> None:
        kinds = ["Across, cm", "Along, cm", "Heading, deg"]
        assert re.findall("<h3>(.*?)</h3>", render_diagnosis_page(diagnosis())) == kinds
        blind = {h: HorizonError(1.0, 1.0, math.nan) for h in (1.0, 5.0)}
        page = render_diagnosis_page(diagnosis(before=blind, after=blind, noise_floor=blind))
        assert re.findall("<h3>(.*?)</h3>", page) == kinds[:2]
        assert "nan" not in page and "nan" not in printed(diagnosis(before=blind, after=blind, noise_floor=blind))
        widths = [float(width) for width in re.findall(r'"bar \w+" style="width: (.*?)%', page)]
        assert len(widths) == 12 and max(widths) == 100.0

    def test_a_curve_with_one_point_has_ticks_that_differ(self) -> None:
        one = np.array([9.0])
        curve = ResidualPlot("wheel angle, deg", "remaining turning rate, deg/s", one, one, 0 * one, 0 * one, 0 * one)
        page = render_diagnosis_page(diagnosis(curve=curve))
        labels = re.findall(r'text-anchor="middle">(.*?)<', page)
        assert len(set(labels)) == len(labels) >= 3 and "9.0" in labels

    def test_names_are_escaped_and_nothing_is_asked_of_the_outside(self) -> None:
        page = render_diagnosis_page(diagnosis(notes=("<b>x",), depends_on=("<b>y",)), "<b>z")
        assert "<b>" not in page and page.count("&lt;b&gt;") >= 3
        assert not re.search(r"""(?:src|href)=["'](?!data:|#)|https?:|url\(|@import""", page)

    @given(st.floats(-1e4, 1e4), st.floats(1e-3, 1e4))
    def test_ticks_lie_inside_at_even_steps_and_read_apart(self, low: float, span: float) -> None:
        axis = ChartAxis(low, low + span, 0.0, 700.0)
        found = axis.list_ticks()
        places, texts = zip(*found, strict=True)
        assert 2 <= len(found) <= 7 and len(set(texts)) == len(texts) and "-0" not in texts
        assert all(0.0 <= place <= 700.0 for place in places)
        assert np.allclose(np.diff(places), places[1] - places[0], atol=0.21)
        assert all(axis.place(float(text)) == pytest.approx(place, abs=0.11) for place, text in found)


class TestJson:
    KEYS = (
        "runs", "rows_used", "rows_gated", "rows_gated_by_reason", "verdict", "faults", "columns",
        "error_before", "error_after", "noise_floor", "guilty_block", "effects", "interval_note", "named",
        "unexplained_share", "residual_error", "unexplained_depends_on", "hints", "holdout", "unsaved_reason",
        "next_drive", "calibration", "plan", "residuals", "correlations", "notes", "tractor", "hidden",
    )  # fmt: skip
    EFFECT_KEYS = (
        "id", "status", "calibrated", "value", "interval", "gain_pct", "gain_interval", "smallest_visible", "unit",
        "block", "equivalent_to", "exchange", "law",
    )  # fmt: skip

    def test_keys(self) -> None:
        found = json.loads(format_diagnosis_json(diagnosis()))
        assert tuple(found) == self.KEYS
        assert all(tuple(one) == self.EFFECT_KEYS for one in found["effects"])
        assert list(found["error_before"]["5"]) == ["cross_cm", "along_cm", "heading_deg"]

    def test_the_guide_names_every_key_and_every_effect_with_its_parameters_and_neutral_value(self) -> None:
        guide = (Path(__file__).parents[2] / "planner" / "guide" / "diagnosis.md").read_text(encoding="utf-8")
        effects, keys = guide.split("## Effects")[1].split("## Keys of `--json`")
        assert [key for key in (*self.KEYS, *self.EFFECT_KEYS) if f"`{key}`" not in keys] == []
        rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in effects.splitlines() if line[:2] == "| "]
        listed = {name: row for row in rows[1:] for name in re.findall("`(.*?)`", row[0])}
        assert sorted(listed) == sorted(entry.id for entry in CATALOGUE)
        for entry in CATALOGUE:
            _, parameters, neutral, _ = listed[entry.id]
            assert {param.name for param in entry.params} <= set(re.findall("`(.*?)`", parameters))
            expected = {None: "file", math.inf: "none"}.get(entry.size.neutral) or f"{entry.size.neutral:g}"
            assert neutral == expected, entry.id

    def test_what_was_hidden(self) -> None:
        hidden = HiddenEffect("steering_offset", {"angle_deg": 1.5})
        assert json.loads(format_diagnosis_json(diagnosis(), hidden))["hidden"] == {
            "id": "steering_offset", "value": {"angle_deg": 1.5},
            "words": "The wheels stand 1.5 degrees to the right when the sensor says straight ahead.",
        }  # fmt: skip
        assert json.loads(format_diagnosis_json(diagnosis()))["hidden"] is None

    def test_what_json_cannot_hold_is_null(self) -> None:
        told = in_model("side_slip", EQUIVALENT, 0.5, interval={"limit_g": (0.4, math.inf)})
        found = json.loads(format_diagnosis_json(diagnosis(told)))
        assert next(one for one in found["effects"] if one["id"] == "side_slip")["interval"] == {"limit_g": [0.4, None]}
        assert "0.5 (0.4 to no limit) g" in page_text(diagnosis(told))
