"""Places where the grip could differ: circles of grid cells compared at once, the best ones refined."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from vehicle.identification.cause_selection.covariates import (
    ColumnProducts,
    PathResponse,
    compute_explained_loss,
    get_steering,
)
from vehicle.identification.fit.residual_fit import EffectFit
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import FEWEST_TURNED_RAD, LEAST_BEND_DEG, MOST_TURNING_SHARE
from vehicle.jit import compile_function

CELLS_PER_SIDE = 30  # cells per longer side of the field: chosen, fine enough for a wet corner
MOST_POLISHED = 2  # circles to refine: chosen, as each costs some hundred simulations of the filter
RADII_CELLS = (1.5, 2.2, 3.2, 4.5, 6.5, 9.0)  # in cells: chosen, from the smallest circle to most of the field
# s: longer segments are cut into pieces, so that memory and time depend on the cells of a piece. A turn shows in the
# residuals of some seconds; the lead before a piece is long enough for earlier turns to decay.
PATCH_PIECE_S, PATCH_LEAD_S = 240.0, 60.0
PatchCircle = tuple[float, float, float]


def find_best_patch(residual_model: ResidualModel, fit: EffectFit) -> PatchCircle | None:
    """Return centre (in the logs' own frame) and radius of the circle whose grip explains most of the remaining
    residuals.

    None when the tractor turns nowhere, or everywhere alike.
    """
    response = PathResponse(residual_model, fit)
    cells = _GripCells(response)
    best: tuple[float, PatchCircle] = (0.0, (0.0, 0.0, 0.0))
    for _, circle in cells.find_best_circles():
        best = max(best, _polish_circle(response, circle, cells.size))
    if best[0] <= 0.0 or _sum_bends_inside(response, best[1]) <= FEWEST_TURNED_RAD:
        return None
    origin = residual_model.dataset.origin
    return best[1][0] + origin[0], best[1][1] + origin[1], best[1][2]


def _list_bends(response: PathResponse) -> Array:
    """Return how far rows turn (rad) with wheels that are set for a bend; small angles to keep a line are none.

    Around straight ahead, play and the law of the radii turn a vehicle less than a share of the angle says.
    """
    angles = np.concatenate([get_steering(segment) for segment in response.residual_model.dataset.segments])
    turned = np.concatenate([move.turned for move in response.increments])
    return np.where(np.degrees(np.abs(angles)) > LEAST_BEND_DEG, np.abs(turned), 0.0)


def _sum_bends_inside(response: PathResponse, circle: PatchCircle) -> float:
    segments = response.residual_model.dataset.segments
    inside = [(s.east[:-1] - circle[0]) ** 2 + (s.north[:-1] - circle[1]) ** 2 < circle[2] ** 2 for s in segments]
    return float(_list_bends(response) @ np.concatenate(inside))


@dataclass(frozen=True)
class _SegmentPiece:
    """Rows `begin` to `end` of a segment, computed from its turns from row `lead` on."""

    index: int
    lead: int
    begin: int
    end: int

    @property
    def turn_slice(self) -> slice:
        """Slice of the turns that affect the rows."""
        return slice(self.lead, self.end - 1)

    def compute_turn_products(self, response: PathResponse, turns: Array) -> ColumnProducts:
        """Return products of the columns that turns (c, n) of the piece cause in its rows."""
        return response.compute_joint_products(self.index, self._compute_columns(response, turns), self.begin)

    def compute_separate_turn_products(self, response: PathResponse, turns: Array) -> ColumnProducts:
        """The same for every column alone: squares (c,), products with the residuals (c,) and with the fit (c, m)."""
        return response.compute_column_products(self.index, self._compute_columns(response, turns), self.begin)

    def _compute_columns(self, response: PathResponse, turns: Array) -> Array:
        columns = response.compute_turn_responses(self.index, turns, self.lead)
        return columns[(self.begin - self.lead) * (len(columns) // (turns.shape[1] + 1)) :]


def _split_pieces(segments: tuple[DriveSegment, ...]) -> Iterator[_SegmentPiece]:
    """Return all rows of all segments, long ones in pieces of equal length."""
    for index, segment in enumerate(segments):
        count = max(round(float(segment.time[-1]) / PATCH_PIECE_S), 1)
        cuts = np.searchsorted(segment.time, np.arange(1, count) * (segment.time[-1] / count))
        begins, ends = [0, *cuts.tolist()], [*cuts.tolist(), segment.rows]
        for begin, end in zip(begins, ends, strict=True):
            if end - begin > 1:
                lead = int(np.searchsorted(segment.time, segment.time[begin] - PATCH_LEAD_S))
                yield _SegmentPiece(index, lead, begin, end)


class _GripCells:
    """The grip of every cell of the field as a column of its own: products summed over the segments."""

    def __init__(self, response: PathResponse) -> None:
        segments = response.residual_model.dataset.segments
        east = np.concatenate([s.east[:-1] for s in segments])
        north = np.concatenate([s.north[:-1] for s in segments])
        self.size = float(max(np.ptp(east), np.ptp(north), 1e-6)) / CELLS_PER_SIDE
        columns, rows = np.floor((east - east.min()) / self.size), np.floor((north - north.min()) / self.size)
        _, first, number = np.unique(columns * 10000 + rows, return_index=True, return_inverse=True)
        self.east = east.min() + (columns[first] + 0.5) * self.size
        self.north = north.min() + (rows[first] + 0.5) * self.size
        count, width = len(first), response.fit.jacobian.shape[1]
        self.square, self.side, self.cross = np.zeros((count, count)), np.zeros(count), np.zeros((count, width))
        starts = np.cumsum([0, *(segment.rows - 1 for segment in segments)])
        for piece in _split_pieces(segments):
            turn_cells = number[starts[piece.index] :][piece.turn_slice]
            turned = response.increments[piece.index].turned[piece.turn_slice]
            cells_of_piece = np.unique(turn_cells)
            square, side, cross = piece.compute_turn_products(
                response, turned * (turn_cells == cells_of_piece[:, None])
            )
            self.square[np.ix_(cells_of_piece, cells_of_piece)] += square
            self.side[cells_of_piece] += side
            self.cross[cells_of_piece] += cross
        self.turned = np.bincount(number, _list_bends(response), count)
        share = self.cross @ response.inverse
        self.square -= share @ self.cross.T
        self.side -= share @ response.side

    def find_best_circles(self) -> list[tuple[float, PatchCircle]]:
        """Return the best circle of each of several sizes, the better ones first."""
        circles = []
        total_turned = float(self.turned.sum())
        distances = np.hypot(self.east - self.east[:, None], self.north - self.north[:, None])
        for radius in self.size * np.array(RADII_CELLS):
            square, side, turned = np.zeros((3, len(distances)))
            _sum_cells_inside_radius(distances, radius, self.square, self.side, self.turned, square, side, turned)
            gains = compute_explained_loss(square.reshape(-1, 1, 1), side[:, None])
            gains[(turned <= FEWEST_TURNED_RAD) | (turned >= MOST_TURNING_SHARE * total_turned)] = 0.0
            best: tuple[float, PatchCircle] = (0.0, (0.0, 0.0, 0.0))
            for place in np.flatnonzero(gains == gains.max()):
                best = max(best, (float(gains[place]), self._make_circle(int(place), float(radius))))
            circles.append(best if best[0] > 0.0 else (0.0, (0.0, 0.0, 0.0)))
        return sorted(circles, reverse=True)[:MOST_POLISHED]

    def _make_circle(self, place: int, radius: float) -> PatchCircle:
        return float(self.east[place]), float(self.north[place]), radius


@compile_function
def _sum_cells_inside_radius(distances, radius, squares, sides, turns, square, side, turned) -> None:  # type: ignore[no-untyped-def]
    """Per cell, sum products, sides and turns over the cells that are nearer than a radius by `away` (c, c)."""
    near_cells = np.empty(len(distances), np.int64)
    for i in range(len(distances)):
        count = 0
        for j in range(len(distances)):
            if distances[i, j] < radius:
                near_cells[count] = j
                count += 1
        for first_index in range(count):
            j = near_cells[first_index]
            side[i] += sides[j]
            turned[i] += turns[j]
            for second_index in range(count):
                square[i] += squares[j, near_cells[second_index]]


def _compute_patch_gains(response: PathResponse, circles: Sequence[PatchCircle]) -> list[float]:
    """Return the loss removed by grip inside each of some circles."""
    e, n, r = (np.array(column)[:, None] for column in zip(*circles, strict=True))
    width, segments = response.fit.jacobian.shape[1], response.residual_model.dataset.segments
    square, side, cross = np.zeros(len(circles)), np.zeros(len(circles)), np.zeros((len(circles), width))
    insides = [(s.east[:-1] - e) ** 2 + (s.north[:-1] - n) ** 2 < r * r for s in segments]
    for piece in _split_pieces(segments):
        inside = insides[piece.index][:, piece.turn_slice]
        touched_circles = np.flatnonzero(inside.any(axis=1))
        if len(touched_circles):
            turned = response.increments[piece.index].turned[piece.turn_slice]
            parts = piece.compute_separate_turn_products(response, turned * inside[touched_circles])
            square[touched_circles] += parts[0]
            side[touched_circles] += parts[1]
            cross[touched_circles] += parts[2]
    circle_products = zip(square.reshape(-1, 1, 1), side[:, None], cross[:, None], strict=True)
    return [response.compute_gain_beyond_fit(*parts) for parts in circle_products]


def _polish_circle(response: PathResponse, circle: PatchCircle, cell: float) -> tuple[float, PatchCircle]:
    """Pattern search over centre and radius together: one edge may stay in place while the other moves."""
    if circle[2] <= 0.0:
        return 0.0, circle
    gains_by_circle = dict(zip([circle], _compute_patch_gains(response, [circle]), strict=True))
    best, step = gains_by_circle[circle], cell
    while step > 0.15 * cell:
        neighbours = [
            (circle[0] + de, circle[1] + dn, max(circle[2] + dr, 0.5 * cell))
            for de, dn, dr in product((-step, 0.0, step), repeat=3)
        ]
        new_circles = [neighbour for neighbour in dict.fromkeys(neighbours) if neighbour not in gains_by_circle]
        gains_by_circle.update(
            zip(new_circles, _compute_patch_gains(response, new_circles) if new_circles else (), strict=True)
        )
        gain, neighbour = max((gains_by_circle[neighbour], neighbour) for neighbour in neighbours)
        if gain > best:
            best, circle = gain, neighbour
        else:
            step *= 0.5
    return best, circle
