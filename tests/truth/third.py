"""The third reference: a tractor on four tyres with a spool valve and a governor, logged by columns with clocks.

It shares with the other references the programmes of commands, the table of effects, the forms of cases and the
measured radii, and nothing of how a log comes about: tests.truth.third_body is the tractor, tests.truth.third_run a
drive. The ground pushes by place (the same when driven again) and by time.
Imports nothing of the project it tests.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pandas as pd

from tests.truth import third_body as body
from tests.truth import third_run as run
from tests.truth.cases import Law, TruthCase
from tests.truth.drives import Drive
from tests.truth.effects import complete
from tests.truth.ground import MAP_SPEED_MPS, Track
from tests.truth.laws import BODY_EFFECTS, P_LAG, P_RATE, encode_law
from tests.truth.recorder import (
    ANTENNA_FORWARD_M,
    Instruments,
    Signals,
    build_log,
    draw_position_errors,
    find_antenna,
    freeze_times,
    list_row_times,
    read_switches,
    record_run,
    time_messages,
)
from tests.truth.signals import NO_CLOCK, draw_coloured, low_pass
from tests.truth.third_drives import PROGRAMMES
from tests.truth.third_outside import OUTSIDE_CAUSES, make_odd

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
DAY_STEP_S = 150.0  # from run to run
TAIL_S = 2.0  # driven on after the last row, for clocks that run ahead
FIELD_SPREAD_M, PATCH_EDGE_M = 9.0, 0.8
GROUND_BY_PLACE, GROUND_BY_TIME, GROUND_S, GUST_S, DEPTH_S = 0.0040, 0.0024, 0.35, 4.0, 7.0
SENSORS = Instruments(
    position_m=0.008, wander_m=0.012, wander_s=25.0, heading_deg=0.08, heading_wander_deg=0.10, heading_wander_s=1.2,
    heading_digit_deg=0.01, speed_mps=0.02, speed_digit_mps=0.01, wheel_deg=0.05, wheel_digit_deg=0.05,
    row_jitter_s=0.004,
)  # fmt: skip


@dataclass(frozen=True)
class Third:
    """The tractor of a case. `ground` scales the roughness of the soil (0: none).

    Raises ValueError for a cause outside the catalogue that this reference does not have.
    """

    case: TruthCase
    sensors: Instruments = SENSORS
    ground: float = 1.0

    def __post_init__(self) -> None:
        unknown = sorted(set(self.case.outside) - set(OUTSIDE_CAUSES))
        if unknown:
            raise ValueError(
                f"The third reference cannot hide {unknown[0]!r}; use one of: {', '.join(OUTSIDE_CAUSES)}."
            )

    @property
    def front_share(self) -> float:
        """Share of the front axle in the driving force: four-wheel drive by every other seed.

        Where the tyres slide the rear axle drives alone: turned wheels that pull would turn beyond their side friction.
        """
        slides = "side_slip" in {*self.case.effects, *(law.effect for law in self.case.laws)}
        return 0.0 if slides or self.case.seed % 2 == 0 else body.FRONT_DRIVE_SHARE

    def track(self, drive: Drive, index: int = 0) -> Track:
        """The drive without instruments; `index` numbers the runs of a programme, each with draws of its own."""
        rng = np.random.default_rng([self.case.seed, index, 31])
        bearing = math.radians(rng.uniform(0.0, 360.0) if drive.bearing_deg is None else drive.bearing_deg)
        place = rng.uniform(-FIELD_SPREAD_M, FIELD_SPREAD_M, 2)
        plain = Third(TruthCase("clean", self.case.seed), Instruments(), 0.0)
        rear = plain._drive(drive, index, (0.0, 0.0, bearing))
        return self._drive(drive, index, rear.find_start(place, bearing))

    def log(self, drive: Drive, index: int = 0) -> pd.DataFrame:
        """The drive as a log in the columns of the contract, the name of the drive in `attrs`."""
        track, case, tool = self.track(drive, index), self.case, self.sensors
        rng = np.random.default_rng([case.seed, index, 32])
        signals = self._list_signals(track, drive)
        times = list_row_times(drive.duration_s, case.rate_hz, tool, rng)
        headings = np.degrees(signals.heading) + signals.follow(case, "heading_bias", index)
        columns = record_run(case, index, signals, self._find_places(track, signals, index), headings, times, tool, rng)
        return build_log(drive.name, columns | read_switches(drive, times))

    def _list_signals(self, track: Track, drive: Drive) -> Signals:
        """What instruments measure: the rear axle's place, the way ahead, and the wheel sensor."""
        columns = (track.column(place) for place in (body.HEADING, body.AHEAD, body.WHEEL))
        return Signals(run.STEP_S, track.day_s, *track.find_point(0.0, 0.0), *columns, track.held_deg,
                       drive.implement(track.time_s))  # fmt: skip

    def _find_places(self, track: Track, signals: Signals, index: int) -> Array:
        """Where the receiver would say its antenna is, at every step (k, 2)."""
        outside, nominal, sway = self.case.outside, ANTENNA_FORWARD_M, np.zeros(len(track.time_s))
        if "mast_sway" in outside:
            pull = low_pass(track.column(body.SIDE_PULL), run.STEP_S, 0.3)
            sway = -outside["mast_sway"]["m_per_mps2"] * pull
        if "articulated" in outside:
            nominal = outside["articulated"]["antenna_forward_m"]
        places = signals.place_antenna(self.case, index, nominal, sway)
        if "trees" in outside:
            odd = make_odd(outside, index)
            places += np.array([run.see_past_trees(east, north, odd) for east, north in places])
        return places + draw_position_errors(self.case, index, track.time_s, self.sensors)

    def _law(self, name: str, index: int) -> Array:
        """A parameter of an effect as a row of tests.truth.laws; a patch and a drift of grip are laws themselves."""
        values = complete(self.case.effects)[name]
        law = next((law for law in self.case.laws if law.effect == name), None)
        if law is None and name == "grip_patch":
            law = Law(name, "by_place", {"inside": values["ratio"], "outside": 1.0, **values})
        elif law is None and name == "grip_drift":
            law = Law(name, "over_minutes", {"start": 1.0, "per_minute": values["per_minute"]})
        elif law is None:
            law = Law(name, "constant", {"value": min(next(iter(values.values())), 1e6)})
        return encode_law(law, index, PATCH_EDGE_M)

    def _laws(self, index: int) -> Array:
        laws = np.array([self._law(name, index) for name in BODY_EFFECTS])
        oil = self.case.outside.get("oil_temperature")
        if oil is not None:
            cold = math.exp(-index * DAY_STEP_S / oil["warm_s"])
            laws[P_LAG, 1] += oil["lag_s"] * cold
            laws[P_RATE, 1] *= 1.0 - oil["rate_share"] * cold
        return laws

    def _drive(self, drive: Drive, index: int, start: tuple[float, float, float]) -> Track:
        rng = np.random.default_rng([self.case.seed, index, 33])
        time = np.arange(0.0, drive.duration_s + TAIL_S, run.STEP_S)
        rough = self.ground * GROUND_BY_TIME * draw_coloured(rng, len(time), run.STEP_S, GROUND_S)
        gusts = draw_coloured(rng, len(time), run.STEP_S, GUST_S)
        depths = 1.0 + 0.8 * np.sign(np.sin(2.0 * np.pi * time / DEPTH_S + rng.uniform(0.0, 6.0)))
        state = np.zeros(body.STATES)
        state[body.EAST], state[body.NORTH], state[body.HEADING] = start
        signal, laws = drive.steering(time), self._laws(index)
        state[body.WHEEL] = 0.0 if drive.closed_loop else signal[0]
        dead = float(self._law("steering_dead_time", index)[1])
        old, old_heading, errors = self._see(index, time, rng)
        slope_to = math.radians(complete(self.case.effects)["cross_slope_drift"]["bearing_deg"])
        odd = make_odd(self.case.outside, index)._replace(slope_to=slope_to)
        states, held = run.roll_on(
            state, index * DAY_STEP_S, signal, drive.speed(time) * drive.shuttle(time), drive.implement(time), depths,
            rough, gusts, old, old_heading, errors, round(dead / run.STEP_S), self.front_share, laws,
            draw_waves(self.case.seed, self.ground), odd, self._breaks(index),
            self._way(drive, start), calibrate_curve(self.front_share),
        )  # fmt: skip
        return Track(time, states, held, states[:, body.AHEAD], body.REAR, index * DAY_STEP_S)

    def _breaks(self, index: int) -> body.Breaks:
        breaks = body.Breaks()
        for fault in (fault for fault in self.case.faults if fault.run == index):
            end = 1e9 if fault.to_s is None else fault.to_s
            if fault.id == "steering_loose":
                breaks = breaks._replace(
                    loose_from=fault.from_s, loose_to=end, linkage=fault.detail.get("linkage", 0.0)
                )
            elif fault.id == "steering_stuck":
                side = fault.detail.get("side", 1.0)
                breaks = breaks._replace(stuck_from=fault.from_s, stuck_to=end, stuck_side=side)
        return breaks

    def _way(self, drive: Drive, start: tuple[float, float, float]) -> body.Way:
        values = complete(self.case.effects)
        bias = math.radians(values["heading_bias"]["angle_deg"])
        return body.Way(drive.closed_loop, *start, *find_antenna(values), ANTENNA_FORWARD_M, bias)

    def _see(self, index: int, time: Array, rng: np.random.Generator) -> tuple[Rows, Rows, Array]:
        """Rows that the path follower gets position and heading from at each step, and the errors of the position."""
        latency, rows = float(self._law("gnss_latency", index)[1]), []
        for name in ("position", "heading"):
            # Where a value stands is not the receiver's stamp: the follower has it when it arrives.
            clock = replace(self.case.columns.get(name, NO_CLOCK), offset_s=0.0, drift_s_per_min=0.0)
            own = np.random.default_rng([self.case.seed, index, 34])
            when = freeze_times(time_messages(time, clock, own), self.case, index, name)
            rows.append(np.maximum(((when - latency) / run.STEP_S).astype(np.int64), 0))
        errors = draw_position_errors(self.case, index, time, self.sensors)
        return rows[0], rows[1], errors + self.sensors.position_m * rng.standard_normal(errors.shape)


def draw_waves(seed: int, ground: float) -> Array:
    """Ridges of the ground: wave numbers to east and north (1/m), phase, and pushes to east and north (slip)."""
    rng = np.random.default_rng([seed, 36])
    turns, lengths = rng.uniform(0.0, 2.0 * np.pi, run.WAVES), np.exp(rng.uniform(np.log(1.5), np.log(9.0), run.WAVES))
    numbers = 2.0 * np.pi / lengths
    pushes = ground * GROUND_BY_PLACE * np.sqrt(2.0 / run.WAVES) * rng.standard_normal((run.WAVES, 2))
    phases = rng.uniform(0.0, 2.0 * np.pi, run.WAVES)
    return np.column_stack([numbers * np.cos(turns), numbers * np.sin(turns), phases, pushes])


@lru_cache(maxsize=2)
def calibrate_curve(front_share: float) -> Array:
    """Mean wheel angle (rad) at even curvatures of the way of the centre of mass, by driving circles at 5 km/h."""
    angles = np.radians(np.linspace(0.0, 50.0, 51))
    ends = np.array([body.settle(angle, MAP_SPEED_MPS, 8.0, front_share) for angle in angles])
    bends = ends[:, body.YAW_RATE] / np.hypot(ends[:, body.AHEAD], ends[:, body.SIDEWAYS])
    grid = np.linspace(-body.TABLE_MOST, body.TABLE_MOST, body.TABLE_SIZE)
    return np.asarray(np.sign(grid) * np.interp(np.abs(grid), bends, angles), dtype=float)


def make_third_logs(case: TruthCase) -> list[pd.DataFrame]:
    """Logs of the case's programme. Raises ValueError for a programme or a cause that this reference does not have."""
    if case.programme not in PROGRAMMES:
        raise ValueError(f"The programme {case.programme!r} is unknown; use one of: {', '.join(PROGRAMMES)}.")
    third = Third(case)
    return [third.log(drive, index) for index, drive in enumerate(PROGRAMMES[case.programme]())]
