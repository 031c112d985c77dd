"""How much of the error no cause explains: what the extended tractor leaves above the noise floor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from vehicle.identification.diagnosis.noise_floor import DRAWS
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveDataset
from vehicle.identification.replay.horizon_errors import HorizonSquares, compute_relative_run_errors

ERROR_PIECE_S = 5.0  # horizon of the errors that are told in words and shares
# Chosen: times the noise floor that counts as noise, and the addition per second between rows, where motion is not
# observed.
ABOVE_FLOOR_FACTOR, ABOVE_FLOOR_PER_ROW_S = 1.3, 1.0
FEW_PIECES_SIGMAS = 2.0  # standard deviations granted to chance between the error of a few pieces and the floor
LEAST_SHARE = 0.02  # chosen: smaller shares are printed as 0
KINDS = 3  # errors of a piece: across, along, heading


@dataclass(frozen=True)
class Unexplained:
    """Share of the error over 5 s above the noise floor that remains, and the horizons (s) with an error above it."""

    share: float
    above_s: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class NoiseLimit:
    """What counts as noise in a dataset: errors are in units of its floor."""

    floor: list[HorizonSquares]
    seconds: float
    row_step_s: float
    along: bool

    def compute_errors(self, squares: list[HorizonSquares], horizon: float = ERROR_PIECE_S) -> Array:
        """The squared error of every run (runs,) in units of the floor; 0 for a run without a piece."""
        return compute_relative_run_errors(squares, self.floor, self.along, horizon)

    def get_floor_error(self, horizon: float) -> float:
        """The floor of all runs in its own unit."""
        return float(self.compute_errors(self.floor, horizon).sum())

    def is_noise(self, squares: list[HorizonSquares], horizon: float) -> bool:
        """Whether errors over a horizon are no more than noise, and motion between rows, would leave by chance."""
        factor = max(ABOVE_FLOOR_FACTOR, 1.0 + compute_chance(self.seconds, horizon))
        limit = (factor + ABOVE_FLOOR_PER_ROW_S * self.row_step_s) * self.get_floor_error(horizon)
        return float(self.compute_errors(squares, horizon).sum()) < limit


def build_noise_limit(floor: list[HorizonSquares], dataset: DriveDataset, row_step_s: float) -> NoiseLimit:
    """What counts as noise in a dataset; the error along the path counts where all speeds were measured."""
    return NoiseLimit(floor, dataset.seconds, row_step_s, all(one.speed_measured for one in dataset.segments))


def measure_unexplained(
    limit: NoiseLimit, before: list[HorizonSquares], after: Sequence[list[HorizonSquares]]
) -> Unexplained:
    """The error that the best of some models leaves: `before` is that of the tractor file, `after` those of models.

    The share is 0 while the error over 5 s is noise.
    """
    best = min(after, key=lambda squares: float(limit.compute_errors(squares).sum()))
    above = tuple(horizon for horizon in list_horizons(best) if not limit.is_noise(best, horizon))
    if ERROR_PIECE_S not in above:
        return Unexplained(0.0, above)
    floor = limit.get_floor_error(ERROR_PIECE_S)
    rest, whole = (float(limit.compute_errors(squares).sum()) - floor for squares in (best, before))
    share = rest / max(rest, whole)
    return Unexplained(share if share > LEAST_SHARE else 0.0, above)


def list_horizons(squares: list[HorizonSquares]) -> list[float]:
    """Horizons (s) of which some run has a piece."""
    return [horizon for horizon in squares[0] if sum(of_run[horizon][3] for of_run in squares) > 0.0]


def compute_chance(seconds: float, piece_s: float) -> float:
    """How far an error and its floor differ by chance for the pieces of this much driving, as a share.

    A mean of n squares has a variance of 2 / n, the floor is drawn DRAWS times, and a piece has three errors.
    """
    pieces = max(seconds / piece_s, 1.0)
    return FEW_PIECES_SIGMAS * math.sqrt(2.0 * (1.0 + 1.0 / DRAWS) / (KINDS * pieces))
