"""Right logs of which one column is in another unit, sign, place or clock, and what a reader makes of them.

A mix-up is in the unit, sign, place, convention or clock of one column or of columns that go together. It is `right`
where the fixes that are told, or what is corrected without asking, give the right columns, or a diagnosis tells the
clock; `remarked` where the logs are refused or the column is named, and nothing is changed; `wrong` where what is
offered, or a cause that is named, is not so; `silent` where nothing is said.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
from pyproj import Transformer

from tests.truth.cases import ColumnClock, TruthCase
from vehicle.identification.diagnosis.other_vehicles import refuse_other_vehicle
from vehicle.identification.errors import LogError
from vehicle.identification.logs.reader import list_remarks, read_logs
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.sensor_checks import correct_sensors_like_others
from vehicle.model.tractor import Tractor

HOME_DEG = (141.3545, 43.0686)  # longitude and latitude of a field in Sapporo
POSITION, SPEEDS, STEERING = (
    ("easting_m", "northing_m"),
    ("speed_mps", "speed_command_mps"),
    ("steering_deg", "steering_command_deg"),
)
CLOCK_COLUMNS = {
    "position": POSITION, "heading": ("heading_deg",), "speed": ("speed_mps",), "steering": ("steering_deg",),
    "steering_command": ("steering_command_deg",),
}  # fmt: skip
CLOCK_S, CLOCK_DRIFT_S_PER_MIN = (0.4, -0.4, 1.5), 1.0
UNITS: tuple[tuple[tuple[str, ...], dict[str, float]], ...] = (
    (("time_s",), {"ms": 1e3, "us": 1e6, "ns": 1e9, "minutes": 1.0 / 60.0}),
    (POSITION, {"km": 1e-3, "cm": 100.0, "mm": 1000.0, "feet": 1.0 / 0.3048}),
    *((names, {"km/h": 3.6, "mph": 2.236936, "knots": 1.943844, "cm/s": 100.0, "mm/s": 1000.0})
      for names in (SPEEDS, *((name,) for name in SPEEDS))),
    (("heading_deg",), {"radians": np.pi / 180.0, "gon": 10.0 / 9.0, "hundredths": 100.0, "turns": 1.0 / 360.0}),
    *((names, {"radians": np.pi / 180.0, "hundredths": 100.0, "share of the lock": 1.0 / 35.0, "steering wheel": 16.0})
      for names in (STEERING, *((name,) for name in STEERING))),
    (("roll_deg", "pitch_deg"), {"radians": np.pi / 180.0}),
)  # fmt: skip
SIGNS = (STEERING, *((name,) for name in STEERING), ("roll_deg",), ("pitch_deg",), ("shuttle",), ("speed_mps",))
SWAPS = (POSITION, STEERING, SPEEDS, ("heading_deg", "steering_deg"), ("heading_deg", "steering_command_deg"),
         ("speed_mps", "steering_deg"), ("heading_deg", "speed_mps"), ("roll_deg", "pitch_deg"))  # fmt: skip
HEADINGS: dict[str, tuple[float, float]] = {
    "counter-clockwise from east": (-1.0, 90.0), "counter-clockwise from north": (-1.0, 0.0),
    "clockwise from east": (1.0, -90.0), "backwards": (1.0, 180.0), "clockwise from west": (1.0, 90.0),
    "counter-clockwise from west": (-1.0, -90.0), "counter-clockwise from south": (-1.0, 180.0),
}  # fmt: skip
"""Factor of the heading, and what is added (deg)."""
RIGHT, REMARKED, WRONG, SILENT = "right", "remarked", "wrong", "silent"
MOST_ROUNDS = 3  # of refusals whose fixes are followed
FIX = re.compile(r"give fixes ([a-z-]+)")
NEAR = {"heading_deg": (1.0, 0.0), "easting_m": (0.05, 0.004), "northing_m": (0.05, 0.004), "speed_mps": (0.03, 0.03),
        "speed_command_mps": (0.03, 0.03), "steering_deg": (0.15, 0.03), "steering_command_deg": (0.15, 0.03),
        "roll_deg": (0.1, 0.0), "pitch_deg": (0.1, 0.0), "shuttle": (0.1, 0.0), "implement": (0.1, 0.0)}  # fmt: skip
"""How far a column may be from the right one: an amount, and a share of its spread."""
Change = Callable[[pd.DataFrame], pd.DataFrame]


@dataclass(frozen=True)
class Mixup:
    """What is done to a log, the columns that are spoiled, and what a clock of a column is."""

    change: Change
    columns: tuple[str, ...]
    clocks: dict[str, ColumnClock] = field(default_factory=dict)

    def make_case(self, seed: int) -> TruthCase:
        """A case without anything but the clock hidden."""
        ids = {f"clock_offset_{name}" for name in self.clocks} | (
            {"gnss_latency"} if "position" in self.clocks else set()
        )
        delays = {f"{name}_delay" for name in self.clocks if name in ("position", "heading")}
        return TruthCase(
            "column" if self.clocks else "mixed", seed, columns=self.clocks, allowed=frozenset(ids | delays)
        )


def scale_columns(names: Sequence[str], factor: float) -> Change:
    """Columns in another unit."""
    return lambda frame: frame.assign(**{name: frame[name] * factor for name in names})


def swap_columns(one: str, other: str) -> Change:
    """Two columns under each other's names."""
    return lambda frame: frame.rename(columns={one: other, other: one})


def turn_heading(factor: float, added_deg: float) -> Change:
    """Headings of another convention."""
    return lambda frame: frame.assign(heading_deg=(factor * frame.heading_deg + added_deg) % 360.0)


def shift_clock(names: Sequence[str], late_s: float, drift_s_per_min: float = 0.0) -> Change:
    """Columns whose rows hold what was true some time ago."""

    def shift(frame: pd.DataFrame) -> pd.DataFrame:
        time = frame.time_s.to_numpy(float)
        then = time - late_s - drift_s_per_min * (time - time[0]) / 60.0
        columns = {}
        for name in names:
            values = frame[name].to_numpy(float)
            if name == "heading_deg":
                values = np.degrees(np.unwrap(np.radians(values)))
            shifted = np.interp(then, time, values)
            columns[name] = shifted % 360.0 if name == "heading_deg" else shifted
        return frame.assign(**columns)

    return shift


def place_on_globe(frame: pd.DataFrame) -> pd.DataFrame:
    """Longitude and latitude in the columns of easting and northing."""
    plane = f"+proj=aeqd +lon_0={HOME_DEG[0]} +lat_0={HOME_DEG[1]} +ellps=WGS84"
    to_globe = Transformer.from_crs(plane, "EPSG:4326", always_xy=True)
    east, north = to_globe.transform(frame.easting_m.to_numpy(), frame.northing_m.to_numpy())
    return frame.assign(easting_m=east, northing_m=north)


def list_mixups() -> dict[str, Mixup]:
    """All mix-ups by name."""
    found: dict[str, Mixup] = {}
    for names, units in UNITS:
        found |= {
            f"{'+'.join(names)} in {unit}": Mixup(scale_columns(names, factor), names) for unit, factor in units.items()
        }
    found |= {f"{'+'.join(names)} of the other sign": Mixup(scale_columns(names, -1.0), names) for names in SIGNS}
    found |= {f"{one} and {other} swapped": Mixup(swap_columns(one, other), (one, other)) for one, other in SWAPS}
    found |= {f"heading {words}": Mixup(turn_heading(*how), ("heading_deg",)) for words, how in HEADINGS.items()}
    for name, columns in CLOCK_COLUMNS.items():
        for late_s in CLOCK_S:
            clock = {name: ColumnClock(offset_s=late_s)}
            found[f"{name} {late_s:g} s late"] = Mixup(shift_clock(columns, late_s), columns, clock)
        drift = {name: ColumnClock(drift_s_per_min=CLOCK_DRIFT_S_PER_MIN)}
        found[f"{name} of a drifting clock"] = Mixup(shift_clock(columns, 0.0, CLOCK_DRIFT_S_PER_MIN), columns, drift)
    found["position in degrees"] = Mixup(place_on_globe, POSITION)
    found["latitude before longitude"] = Mixup(lambda frame: swap_columns(*POSITION)(place_on_globe(frame)), POSITION)
    found["implement 1 where it is lifted"] = Mixup(
        lambda frame: frame.assign(implement=1 - frame.implement), ("implement",)
    )
    return found


MIXUPS = list_mixups()


def mix_up(name: str, frame: pd.DataFrame) -> pd.DataFrame:
    """The log with a mix-up of MIXUPS."""
    out = MIXUPS[name].change(frame)
    out.attrs["name"] = frame.attrs["name"]
    return out


@dataclass(frozen=True, eq=False)
class Reading:
    """What reading ended in: the logs, unless they are refused, the fixes that were followed, and all that was said."""

    logs: list[Log] | None
    fixes: tuple[str, ...]
    words: str


def read_as_told(frames: Sequence[pd.DataFrame], tractor: Tractor) -> Reading:
    """Read logs as a user does, who gives the fixes that a refusal asks for."""
    fixes: list[str] = []
    with TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{frame.attrs['name']}.csv" for frame in frames]
        for frame, path in zip(frames, paths, strict=True):
            frame.to_csv(path, index=False)
        for _ in range(MOST_ROUNDS + 1):
            try:
                logs = correct_sensors_like_others(read_logs(paths, fixes, tractor.wheelbase_m))
                refuse_other_vehicle(logs, tractor, "soil")
            except LogError as error:
                more = [fix for fix in dict.fromkeys(FIX.findall(str(error))) if fix not in fixes]
                if not more:
                    return Reading(None, tuple(fixes), str(error))
                fixes += more
            else:
                return Reading(logs, tuple(fixes), " ".join(remark for log in logs for remark in list_remarks(log)))
    return Reading(None, tuple(fixes), "asks for one fix after another")


def judge_reading(mixup: Mixup, reading: Reading, right: Sequence[Log]) -> str | None:
    """The outcome of reading, by the logs as they are without the mix-up; None where only a diagnosis can tell."""
    if reading.logs is None:
        return WRONG if reading.fixes else REMARKED
    read = {log.name: log for log in reading.logs}
    if set(read) != {log.name for log in right}:  # what is left out is told
        return WRONG if reading.fixes else REMARKED
    differing = {name for log in right for name in list_differing(read[log.name], log)}
    if not differing and not mixup.clocks:
        return RIGHT
    if reading.fixes:
        return WRONG
    return REMARKED if any(name in reading.words for name in mixup.columns) else None


def list_differing(log: Log, right: Log) -> list[str]:
    """Columns that are neither left out nor what they are in the right log."""
    count = min(len(log.time_s), len(right.time_s))
    found = []
    for name, (amount, share) in NEAR.items():
        values, wanted = getattr(log, name), getattr(right, name)
        if values is None or wanted is None:
            continue
        values, wanted = values[:count], wanted[:count]
        if name in POSITION:
            values, wanted = values - values[0], wanted - wanted[0]
        apart = values - wanted
        apart = (apart + 180.0) % 360.0 - 180.0 if name == "heading_deg" else apart
        used = log.used[:count] & right.used[:count]
        if np.median(np.abs(apart[used])) > amount + share * np.ptp(wanted[used]):
            found.append(name)
    return found
