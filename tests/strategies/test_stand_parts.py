"""A tractor that stands on the field with less than a load is served before the line it begins with, if need be."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from strategies.rules.supply import Supply
from strategies.service_stops.tour_parts import build_part, cut_at_wait_points, cut_to_loads
from strategies.service_stops.tour_stops import TourGaps
from vehicle.missions.plan import SWATH, Leg, LegTask

LENGTH_M = 60.0


def build_table(used: float) -> Any:
    """One line of 60 m, 1 m wide, on which a tractor stands that has used so much."""
    line = SimpleNamespace(task=LegTask(SWATH), measure_path_m=lambda way: LENGTH_M)
    leg = Leg(np.array([[0.0, 0.0], [LENGTH_M, 0.0]]), 1.0, implement=True)
    moves = SimpleNamespace(get_used=lambda node: used * (node == 0), build_work_leg=lambda node, leave_m: leg)
    site = SimpleNamespace(width_m=1.0, lane=None, rules=SimpleNamespace(work_speed_mps=1.0))
    is_proven = lambda u, v: False  # noqa: E731
    return SimpleNamespace(lines=[line], moves=moves, site=site, starts=(0,), gate=2, is_proven=is_proven)


def list_stops(used: float) -> list[int]:
    supply = Supply(100.0, 1.0, 30.0)
    table = build_table(used)
    gaps = TourGaps(table, supply, cut_to_loads(table, supply, (0,)), None)
    return [stop.gap for stop in gaps.list_stops()]


def test_who_has_enough_left_for_its_line_begins_at_once() -> None:
    assert list_stops(0.0) == list_stops(40.0) == []


def test_who_has_not_is_served_where_it_stands() -> None:
    assert list_stops(41.0) == list_stops(100.0) == [1]


def test_a_place_where_one_stands_is_no_piece_of_its_line() -> None:
    table = build_table(50.0)
    stand, piece = cut_at_wait_points(table, cut_to_loads(table, Supply(100.0, 1.0, 30.0), (0,)))
    assert stand.is_stand and stand.last_m == 0.0 and not stand.is_last
    assert stand.leads_to(piece) and not piece.leads_to(stand)
    assert piece == build_part(table, 0) and piece.last_m == LENGTH_M and piece.is_last
