"""Figures: what is drawn, where, and that the same input gives the same picture."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from reports.common.plan_records import PlanDrive
from reports.common.wording import format_duration
from reports.plan.leg_list import format_leg_rows
from reports.plan.map_figure import _format_leg_columns, draw_plan_map, render_png, render_svg
from reports.trials.report import draw_panel
from vehicle.trials.sheets.sheet import PlotLine, PlotPanel


def test_map_is_to_scale_and_holds_everything(drive: PlanDrive) -> None:
    from matplotlib.collections import LineCollection

    figure = draw_plan_map(drive)
    axes = figure.axes[0]
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    for cloud in (drive.boundary, *drive.xy):
        assert west < cloud[:, 0].min() < cloud[:, 0].max() < east
        assert south < cloud[:, 1].min() < cloud[:, 1].max() < north
    lines = [item for item in axes.collections if isinstance(item, LineCollection)]
    drawn = sum(float(np.hypot(*np.diff(one, axis=0).T).sum()) for item in lines for one in item.get_segments())
    driven = sum(float(np.hypot(*np.diff(xy, axis=0).T).sum()) for xy in drive.xy)
    assert drawn == pytest.approx(driven, rel=2e-3)
    figure.canvas.draw()
    corners = axes.transData.transform([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]])
    assert corners[1, 0] - corners[0, 0] == pytest.approx(corners[2, 1] - corners[0, 1], rel=1e-6)
    assert figure._suptitle.get_window_extent().y0 - axes.transData.transform((0.0, 70.0))[1] < 0.6 * figure.dpi
    lowest = axes.transData.transform((0.0, -1.0 - 0.1 * 273.0))[1]
    legend = figure.legends[0].get_window_extent()
    assert 0.0 <= lowest - legend.y1 < 0.3 * figure.dpi and legend.y0 < 0.5 * figure.dpi, "no paper is wasted"


def test_map_legend_names_every_tractor_and_mark(drive: PlanDrive) -> None:
    words = {text.get_text() for text in draw_plan_map(drive).legends[0].get_texts()}
    assert {"tractor 1", "tractor 2", "tractor 3", "working", "turning", "reversing", "waiting", "entrance"} <= words
    calm = replace(drive, status=tuple(np.ones_like(status) for status in drive.status), entrance=None)
    assert not {"reversing", "waiting", "entrance"} & {
        text.get_text() for text in draw_plan_map(calm).legends[0].get_texts()
    }


def test_ground_that_is_not_worked_is_hatched_and_its_largest_piece_marked(
    drive: PlanDrive, open_drive: PlanDrive
) -> None:
    for one, is_told in ((open_drive, True), (drive, False)):
        figure = draw_plan_map(one)
        assert ("590 m2 missed here, 690 m2 in all" in [text.get_text() for text in figure.axes[0].texts]) is is_told
        assert ("not worked" in {text.get_text() for text in figure.legends[0].get_texts()}) is is_told
        assert is_told or not any("left" in text.get_text() for text in figure.axes[0].texts)


def test_a_picture_says_field_plan_width_tracks_tractors_and_time(drive: PlanDrive) -> None:
    figure = draw_plan_map(replace(drive, title="split-field, 3 tractors, turns: omega"), "Long Acre")
    text = " ".join(figure.get_suptitle().split())
    said = "Long Acre: split-field, 3 tractors, turns: omega width 3 m, 23 tracks, done in "
    assert text.startswith(said)
    hours, minutes, seconds = text.split("done in ")[1].split(" ")[0].split(":")
    assert 3600 * int(hours) + 60 * int(minutes) + int(seconds) == pytest.approx(max(drive.finish_s), abs=0.51)
    assert draw_plan_map(drive, "Iwamizawa").get_suptitle().count("Iwamizawa") == 1


def test_a_picture_states_the_end_that_tables_state_and_what_its_drive_is(drive: PlanDrive) -> None:
    drawn_s = max(drive.finish_s)
    drawn = format_duration(drawn_s)
    for stated_s, has_delays, told in (
        (drawn_s - 41.0, False, f"(the drive as drawn: {drawn})"),
        (drawn_s + 600.0, True, f"(the drive as drawn, without late starts, stops and breakdowns: {drawn})"),
        (drawn_s, False, ""),
    ):
        title = draw_plan_map(replace(drive, stated_end_s=stated_s, has_delays=has_delays)).get_suptitle()
        assert f"done in {format_duration(stated_s)} {told}".rstrip() in " ".join(title.split())
        assert ("as drawn" in title) is bool(told)


@pytest.mark.parametrize(("tracks", "names", "told"), [(1, (), "1 track,"), (3, ("1", "2a", "2b"), "2 tracks,")])
def test_pieces_of_a_track_are_one_track(drive: PlanDrive, tracks: int, names: tuple[str, ...], told: str) -> None:
    cut = replace(drive, title="a plan", swaths=drive.swaths[:tracks], swath_names=names)
    assert told in " ".join(draw_plan_map(cut).get_suptitle().split())


def test_the_title_lies_inside_the_picture(drive: PlanDrive) -> None:
    from matplotlib.transforms import Bbox

    tall = replace(drive, boundary=drive.boundary[:, ::-1], xy=tuple(xy[:, ::-1] for xy in drive.xy),
                   swaths=drive.swaths[:, :, ::-1], holes=())  # fmt: skip
    for one in (drive, tall):
        figure = draw_plan_map(one, "A field with a name of some length")
        figure.canvas.draw()
        title = next(text for text in figure.texts if "width 3 m" in text.get_text())
        box: Bbox = title.get_window_extent()
        assert box.x0 >= 0 and box.x1 <= figure.bbox.width and box.y1 <= figure.bbox.height
        assert box.y0 >= figure.axes[0].get_window_extent().y1, "and above the map"


def test_tracks_are_numbered_at_both_ends_where_there_is_room(drive: PlanDrive) -> None:
    axes = draw_plan_map(drive).axes[0]
    numbers = [text for text in axes.texts if text.get_zorder() == 6 and text.get_text().isdigit()]
    ends = {"west": [n for n in numbers if n.xy[0] < 100], "east": [n for n in numbers if n.xy[0] > 100]}
    for side in ends.values():
        assert len(side) >= 6
        for one in side:
            track = drive.swaths[int(one.get_text()) - 1]
            nearest = np.hypot(*(track - one.xy).T).min()
            assert nearest == pytest.approx(0.012 * 273.0, rel=0.01), "it stands at its own track"
        heights = sorted(one.xy[1] for one in side)
        assert np.diff(heights).min() >= 0.022 * 273.0 * (1 - 1e-9)


def test_arrows_point_the_way_a_track_is_driven(drive: PlanDrive) -> None:
    from matplotlib.collections import PolyCollection

    heads = [item for item in draw_plan_map(drive).axes[0].collections
             if isinstance(item, PolyCollection) and item.get_zorder() == 5]  # fmt: skip
    assert len(heads) == 3
    for item, xy, status in zip(heads, drive.xy, drive.status, strict=True):
        for path in item.get_paths():
            tip, left, right = path.vertices[:3]
            middle = (left + right) / 2
            assert tip[1] == pytest.approx(middle[1], abs=1e-6)
            here = np.flatnonzero((status[1:] == 1) & (np.abs(xy[1:, 1] - tip[1]) < 1e-6))
            assert (xy[here[-1] + 1, 0] - xy[here[0], 0]) * (tip[0] - middle[0]) > 0


def test_scale_bar_is_as_long_as_it_says(drive: PlanDrive) -> None:
    axes = draw_plan_map(drive).axes[0]
    told = next(text.get_text() for text in axes.texts if text.get_text().endswith(" m"))
    bars = [line.get_xdata() for line in axes.lines if len(line.get_xdata()) == 2]
    assert [float(bar[1] - bar[0]) for bar in bars] == [pytest.approx(float(told.removesuffix(" m")))]


def test_svg_is_the_same_letter_by_letter(drive: PlanDrive, open_drive: PlanDrive, still_drive: PlanDrive) -> None:
    for one in (drive, open_drive):
        text = render_svg(draw_plan_map(one))
        assert text == render_svg(draw_plan_map(one))
        assert text.startswith("<?xml") and "dc:date" not in text
    for title in ("costs $5 or $6_x", "$a^$"):
        assert title in render_svg(draw_plan_map(replace(drive, title=title))), "dollar signs are text"
    assert "Iwamizawa" in render_svg(draw_plan_map(still_drive)), "one moment on a field without tracks"


def test_a_png_has_the_size_of_its_figure(drive: PlanDrive) -> None:
    figure = draw_plan_map(drive)
    data = render_png(figure)
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert int.from_bytes(data[16:20], "big") == int(figure.get_figwidth() * 150)


def test_a_field_without_tractors_shows_its_swaths(drive: PlanDrive) -> None:
    nobody: dict[str, tuple[float, ...]] = dict.fromkeys(drive.seconds, ())
    empty = replace(drive, xy=(), status=(), finish_s=(), seconds=nobody)
    figure = draw_plan_map(empty)
    strips = figure.axes[0].collections[0].get_paths()
    assert len(strips) == len(drive.swaths)
    heights = [strip.get_extents().height for strip in strips]
    assert heights == pytest.approx([drive.width_m] * len(strips))
    assert {text.get_text() for text in figure.legends[0].get_texts()} == {"tracks of 3 m", "entrance"}


def test_places_without_a_value_stay_on_the_picture() -> None:
    x = np.linspace(0.7, 1.7, 11)
    lines = tuple(
        PlotLine(f"{first} on", x, np.where(np.arange(11) < first, np.nan, 10.0 - x), number)
        for number, first in enumerate((2, 6))
    )
    axes = draw_panel(PlotPanel("Radius", "Place (m)", "Radius (m)", lines, missing="oversteer")).axes[0]
    (west, east), low = axes.get_xlim(), axes.get_ylim()[0]
    assert west < 0.7 and east > 1.7
    crosses = [line for line in axes.lines if line.get_marker() == "x" and len(line.get_xdata())]
    assert [len(line.get_xdata()) for line in crosses] == [2, 6]
    assert [line.get_color() for line in crosses] == [line.get_color() for line in axes.lines[:2]]
    edges = [axes.transData.inverted().transform(line.get_transform().transform(line.get_xydata()))[0, 1]
             for line in crosses]  # fmt: skip
    assert low < edges[0] < edges[1] < 10.0 - 1.7
    legend = axes.get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["2 on", "6 on", "oversteer"]


def test_lists_of_legs_stand_below_a_wide_map_and_beside_a_tall_one(listed_drive: PlanDrive) -> None:
    def turned(points: np.ndarray) -> np.ndarray:
        return points[..., ::-1]

    tall = replace(
        listed_drive, boundary=turned(listed_drive.boundary), holes=(), headland_passes=(), cells=(), obstacles=(),
        xy=tuple(turned(xy) for xy in listed_drive.xy[:2]), swaths=turned(listed_drive.swaths), entrance=None,
        status=listed_drive.status[:2], finish_s=listed_drive.finish_s[:2], steps=listed_drive.steps[:2],
        seconds={name: values[:2] for name, values in listed_drive.seconds.items()},
    )  # fmt: skip
    for drive, beside in ((listed_drive, False), (tall, True)):
        figure = draw_plan_map(drive)
        figure.canvas.draw()
        area = figure.axes[0].get_window_extent()
        lists = [text for text in figure.texts if text.get_text().startswith("Tractor ")]
        told = "\n".join(text.get_text() for text in lists).splitlines()
        names = [line.split(":")[0] for line in told if line.startswith("Tractor")]
        assert names == [f"Tractor {number + 1}" for number in range(len(drive.steps))]
        boxes = [text.get_window_extent() for text in lists]
        for box in boxes:
            assert box.x0 >= 0 and box.x1 <= figure.bbox.width and box.y0 >= 0 and box.y1 <= figure.bbox.height
            assert box.x0 >= area.x1 if beside else box.y1 <= area.y0
        assert all(a.x1 <= b.x0 for a, b in pairwise(boxes)), "they do not lie over each other"


def test_a_list_without_room_is_left_to_the_numbers(listed_drive: PlanDrive) -> None:
    long = replace(listed_drive, steps=tuple(own * 60 for own in listed_drive.steps))
    figure = draw_plan_map(long)
    assert not [text for text in figure.texts if "Tractor " in text.get_text()]
    assert {text.get_text() for text in figure.axes[0].texts} >= {"R1", "R2", "cell 1: 90\N{DEGREE SIGN}", "2"}


def test_a_list_too_long_for_a_column_is_parted_evenly(listed_drive: PlanDrive) -> None:
    own = listed_drive.steps[0]
    steps = tuple((own * (70 // len(own) + 1))[:70] for _ in range(1))
    columns = [text.splitlines() for text in _format_leg_columns(replace(listed_drive, steps=steps), 60)]
    assert [column[0].split(":")[0] for column in columns] == ["Tractor 1", "Tractor 1, continued"]
    assert abs(len(columns[0]) - len(columns[1])) <= 1
    assert max(map(len, columns)) <= 60
    rows = [row for column in columns for row in column[1:]]
    assert rows == format_leg_rows(steps[0])
