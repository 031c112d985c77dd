"""Names on maps: none overprints another, and ground that is cut off is called so."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from reports.figures import map_figure
from reports.landmarks import cut_off_labels, leg_numbers, missed_label, round_labels, track_labels, work_marks
from reports.page import plan_page
from reports.paths import Extent
from reports.results import CellOutline, Drive, MissedPiece, Ranking, RoundLine

HEIGHT, LETTER = 1.5, 0.9  # of the largest of these texts, in hundredths of the larger side of a map


def ring(low: float, high: float) -> np.ndarray:
    return np.array([[low, low], [high, low], [high, high], [low, high], [low, low]])


@pytest.fixture
def crowded(drive: Drive) -> Drive:
    """Tracks every 1.5 m with long names, in two cells that meet, rounds beside their ends."""
    rows = np.arange(10.0, 90.0, 1.5)
    tracks = np.concatenate([[[[10.0, y], [50.0, y]] for y in rows], [[[50.0, y], [90.0, y]] for y in rows]])
    return replace(
        drive, boundary=ring(0, 100), holes=(), tracks=tracks,
        track_names=tuple(f"{number}a" for number in range(len(tracks))),
        rounds=tuple(RoundLine(number, ring(3 * number - 1.5, 101.5 - 3 * number)) for number in (1, 2, 3)),
        cells=(CellOutline(1, 90.0, (ring(10, 90),), 50.0, 50.0),),
    )  # fmt: skip


def test_names_do_not_overprint_each_other(crowded: Drive) -> None:
    labels = [*track_labels(crowded, 100.0), *round_labels(crowded, 100.0)]
    assert {"R1", "R2", "R3"} <= {label.text for label in labels} and len(labels) > 20
    for one, other in combinations(labels, 2):
        apart = np.abs(one.place - other.place)
        across = 0.5 * LETTER * (len(one.text) + len(other.text))
        assert apart[0] >= across or apart[1] >= HEIGHT, (one.text, other.text)


def test_numbers_of_legs_keep_off_each_other(listed_drive: Drive) -> None:
    size = 273.0
    numbers = [label for marks in work_marks(listed_drive, size) for label in leg_numbers(marks)]
    assert len(numbers) > 3
    for one, other in combinations(numbers, 2):
        assert float(np.hypot(*(one.place - other.place))) >= 0.02 * size


def test_ground_that_is_cut_off_is_named_where_it_lies(drive: Drive, ranking: Ranking) -> None:
    cut = replace(drive, cut_off=(MissedPiece(1700.0, 20.0, 30.0), MissedPiece(3.0, 1.0, 1.0)), worked_pct=98.76)
    (label,) = cut_off_labels(cut)
    assert label.text == "0.17 ha cut off" and label.place.tolist() == [20.0, 30.0]
    title = map_figure(cut, "f").get_suptitle()
    assert "98.8 % worked" in title and "0.17 ha cut off by obstacles" in title
    page = plan_page(replace(ranking, cut_off_m2=1703.0), cut)
    assert ">0.17 ha cut off</text>" in page
    assert "Obstacles cut off 0.17 ha of the field" in page.replace("\N{NO-BREAK SPACE}", " ")


def test_what_is_told_of_missed_ground_keeps_off_the_entrance(drive: Drive) -> None:
    piece = MissedPiece(120.0, 50.0, 40.0)
    far = replace(drive, largest_missed=piece, entrance=(10.0, 10.0))
    box = Extent(0.0, 0.0, 100.0, 100.0)
    label = missed_label(far, box)
    assert label is not None and label.place.tolist() == [50.0, 40.0]
    moved = missed_label(replace(far, entrance=(51.0, 40.5)), box)
    assert moved is not None and moved.text == label.text == "120 m2 left"
    assert moved.place[0] == 50.0 and abs(moved.place[1] - 40.5) >= 2.0
