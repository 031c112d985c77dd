"""The tracks of one tractor in an order found with its loads: turns, ways to the place and stops together.

Ways to the place and back are estimated first, and worked out where an order uses them, until one uses no estimate.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fields.layout import Track
from strategies.job import Job
from strategies.orders.sequence import Searched
from strategies.orders.table import TurnTable
from strategies.orders.tours import FAR_S
from strategies.refilling.berths import berths
from strategies.refilling.loads import Loads, Task
from strategies.refilling.search import EFFORT, in_loads
from strategies.refilling.stops import way_to
from strategies.supply import PLACE, Supply
from strategies.ways.paths import Pose
from strategies.ways.search import shortest_m

Floats = npt.NDArray[np.float64]

MOST_ROUNDS = 6
SAME_S = 1e-3


def searched_in_loads(found: Searched, job: Job, table: TurnTable, supply: Supply) -> Searched:
    """The tracks of an order in one that is best with its loads; the same where one load is enough for all."""
    need = np.array([supply.need(one.track.length, job.layout.width_m) for one in found.order])
    if need.sum() <= supply.capacity:
        return found
    place = {track: index for index, track in enumerate(job.layout.tracks)}
    members = [place[one.track] for one in found.order]
    trips = Trips(job, table, supply, members)
    starts = [list(range(len(members))), _side_by_side(found, job)]
    best = in_loads(trips.task(need), starts)
    for _ in range(MOST_ROUNDS):
        if not trips.work_out(best):
            break
        best = in_loads(trips.task(need), [(best.passes // 2).tolist(), starts[0]], effort=EFFORT // 4)
    if best.seconds >= FAR_S:
        return found
    work = sum(one.track.length for one in found.order) / job.manner.work_speed_mps
    return Searched([table.passes[p] for p in trips.rows[best.passes].tolist()], work + best.seconds, found.found)


def _side_by_side(found: Searched, job: Job) -> list[int]:
    """The places in an order of its tracks one after another."""
    tracks: list[Track] = [one.track for one in found.order]
    return sorted(range(len(tracks)), key=lambda n: (tracks[n].cell, tracks[n].line, tracks[n].piece))


class Trips:
    """Seconds to the place from the end of every pass of some tracks, and from there to the beginning of every other.

    `to` and `on` (b, 2 n) have a row for every pose that a tractor may stand in; without a place they are empty.
    """

    def __init__(self, job: Job, table: TurnTable, supply: Supply, members: list[int]) -> None:
        self.job, self.table, self.supply = job, table, supply
        self.rows = np.array([2 * track + way for track in members for way in (0, 1)])
        self.passes = [table.passes[row] for row in self.rows]
        self.berths: tuple[Pose, ...] = berths(job) if supply.where == PLACE else ()
        self.to = np.array([[self._flight_s(job.exit(one), spot) for one in self.passes] for spot in self.berths])
        self.on = np.array([[self._flight_s(spot, job.entry(one)) for one in self.passes] for spot in self.berths])
        self.known: set[tuple[int, int]] = set()

    def _flight_s(self, a: Pose, b: Pose) -> float:
        manner = self.job.manner
        return shortest_m(np.array(a), np.array(b), manner.radius_m) / manner.turn_speed_mps

    def task(self, need: Floats) -> Task:
        """What the search is given."""
        turns = self.table.seconds[np.ix_(self.rows, self.rows)]
        first, last = np.ascontiguousarray(self.table.ends()[:, self.rows])
        detours = turns if not self.berths else (self.to[:, :, None] + self.on[:, None, :]).min(axis=0)
        tracks = np.arange(len(self.rows)) // 2
        detours = np.where(tracks[:, None] == tracks[None, :], FAR_S, detours + self.supply.refill_s)
        return Task(turns, detours, first, last, need, self.supply.capacity, self.supply.capacity)

    def work_out(self, loads: Loads) -> bool:
        """Work out whatever an order uses and is only estimated; whether there was any."""
        order = self.rows[loads.passes].tolist()
        parts = np.split(np.array(order), loads.cuts)
        missing = sum(self.table.work_out(part.tolist()) for part in parts) > 0
        for cut in loads.cuts if self.berths else ():
            p, q = int(loads.passes[cut - 1]), int(loads.passes[cut])
            for end, one in ((0, p), (1, q)):
                if (end, one) not in self.known:
                    self.known.add((end, one))
                    self._drive(end, one)
                    missing = True
        return missing

    def _drive(self, end: int, one: int) -> None:
        """The seconds of the ways to the place after a pass (`end` 0), or from there to it (1)."""
        for row, spot in enumerate(self.berths):
            job, this = self.job, self.passes[one]
            way = way_to(job, spot, job.entry(this)) if end else way_to(job, job.exit(this), spot)
            seconds = FAR_S if way is None else round(self.job.connector.cost(way) / SAME_S) * SAME_S
            (self.on if end else self.to)[row, one] = seconds
