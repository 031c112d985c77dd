"""Names on maps: none overprints another, and ground that is cut off is called so."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from reports.common.plan_records import CellOutline, HeadlandPassLine, PlanDrive, UnworkedPiece
from reports.common.plan_results import PlanRanking
from reports.plan.drive_geometry import MapExtent
from reports.plan.map_figure import draw_plan_map
from reports.plan.map_labels import (
    place_cut_off_labels,
    place_headland_pass_labels,
    place_leg_marks,
    place_swath_labels,
    place_unworked_label,
)
from reports.plan.ranking_page import render_plan_page

HEIGHT, LETTER = 1.5, 0.9  # of the largest of these texts, in hundredths of the larger side of a map


def ring(low: float, high: float) -> np.ndarray:
    return np.array([[low, low], [high, low], [high, high], [low, high], [low, low]])


@pytest.fixture
def crowded(drive: PlanDrive) -> PlanDrive:
    """Tracks every 1.5 m with long names, in two cells that meet, rounds beside their ends."""
    rows = np.arange(10.0, 90.0, 1.5)
    tracks = np.concatenate([[[[10.0, y], [50.0, y]] for y in rows], [[[50.0, y], [90.0, y]] for y in rows]])
    sides = (HeadlandPassLine(n, ring(3 * n - 1.5, 101.5 - 3 * n), f"R{n}") for n in (1, 2, 3))
    cells, names = (CellOutline(1, 90.0, (ring(10, 90),), 50.0, 50.0),), (f"{n}a" for n in range(len(tracks)))
    return replace(drive, boundary=ring(0, 100), holes=(), swaths=tracks, swath_names=tuple(names),
                   headland_sides=tuple(sides), cells=cells)  # fmt: skip


def test_names_do_not_overprint_each_other(crowded: PlanDrive) -> None:
    labels = [*place_swath_labels(crowded, 100.0), *place_headland_pass_labels(crowded, 100.0)]
    assert {"R1", "R2", "R3"} <= {label.text for label in labels} and len(labels) > 20
    for one, other in combinations(labels, 2):
        apart = np.abs(one.place - other.place)
        across = 0.5 * LETTER * (len(one.text) + len(other.text))
        assert apart[0] >= across or apart[1] >= HEIGHT, (one.text, other.text)


def test_numbers_of_legs_keep_off_each_other(listed_drive: PlanDrive) -> None:
    size = 273.0
    numbers = [label for marks in place_leg_marks(listed_drive, size) for _, label in marks]
    assert len(numbers) > 3
    for one, other in combinations(numbers, 2):
        assert float(np.hypot(*(one.place - other.place))) >= 0.02 * size


def test_ground_that_is_cut_off_is_named_where_it_lies(drive: PlanDrive, ranking: PlanRanking) -> None:
    cut = replace(drive, cut_off=(UnworkedPiece(1700.0, 20.0, 30.0), UnworkedPiece(3.0, 1.0, 1.0)), worked_pct=98.76)
    (label,) = place_cut_off_labels(cut)
    assert label.text == "0.17 ha cut off" and label.place.tolist() == [20.0, 30.0]
    title = draw_plan_map(cut, "f").get_suptitle()
    assert "98.8 % worked" in title and "0.17 ha cut off by obstacles" in title
    page = render_plan_page(replace(ranking, cut_off=UnworkedPiece(1703.0, 20.0, 30.0)), cut)
    assert ">0.17 ha cut off</text>" in page
    assert "Obstacles cut off 0.17 ha, which no plan works." in page.replace("\N{NO-BREAK SPACE}", " ")


def test_the_title_says_when_the_headland_is_worked(drive: PlanDrive) -> None:
    worked = replace(drive, headland_passes=(HeadlandPassLine(2, drive.boundary),))
    for order, said in ((None, "2 headland passes,"), ("last", "2 headland passes last,")):
        title = draw_plan_map(replace(worked, headland_order=order), "f").get_suptitle()
        assert said in " ".join(title.split())


def test_what_is_told_of_missed_ground_keeps_off_the_entrance(drive: PlanDrive) -> None:
    far = replace(drive, largest_missed=UnworkedPiece(120.0, 50.0, 40.0), entrance=(10.0, 10.0))
    box = MapExtent(0.0, 0.0, 100.0, 100.0)
    label, moved = (place_unworked_label(one, box) for one in (far, replace(far, entrance=(51.0, 40.5))))
    assert label.place.tolist() == [50.0, 40.0] and moved.text == label.text == "120 m2 missed"
    assert moved.place[0] == 50.0 and abs(moved.place[1] - 40.5) >= 2.0
    for missed_m2, text in ((700.0, "120 m2 missed here, 700 m2 in all"), (120.2, "120 m2 missed")):
        assert place_unworked_label(replace(far, missed_m2=missed_m2), box).text == text, "how much in all"
