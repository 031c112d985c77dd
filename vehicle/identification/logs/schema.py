"""A measured log: its columns and what others call them, its rows, what may be wrong with it, and its segments."""

from __future__ import annotations

import difflib
import math
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fields.errors import mark_parameter

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.int64]

NEEDED_COLUMNS = ("time_s", "easting_m", "northing_m")
STEERING_COLUMNS = ("steering_command_deg", "steering_deg")
OPTIONAL_COLUMNS = (
    "heading_deg", "speed_mps", "speed_command_mps", "shuttle", "implement", "roll_deg", "pitch_deg", "elevation_m",
)  # fmt: skip
COLUMNS = NEEDED_COLUMNS + STEERING_COLUMNS + OPTIONAL_COLUMNS


class LogConvention(StrEnum):
    """Conventions that a log may follow instead of the contract's; the value is the name of the option."""

    TIME_MS = "time-ms"
    TIME_US = "time-us"
    TIME_NS = "time-ns"
    EAST_NORTH_SWAPPED = "east-north-swapped"
    POSITION_DEGREES = "position-degrees"
    POSITION_KM = "position-km"
    SPEED_KMH = "speed-kmh"
    SPEED_MEASURED_KMH = "speed-measured-kmh"
    SPEED_COMMAND_KMH = "speed-command-kmh"
    HEADING_RADIANS = "heading-radians"
    HEADING_CCW_EAST = "heading-ccw-east"
    HEADING_CCW_NORTH = "heading-ccw-north"
    HEADING_REVERSED = "heading-reversed"
    STEERING_SWAPPED = "steering-swapped"
    STEERING_RADIANS = "steering-radians"
    STEERING_LEFT = "steering-left-positive"
    IMPLEMENT_REVERSED = "implement-reversed"
    ROLL_LEFT = "roll-left-down"


FIX_MEANINGS = {
    LogConvention.TIME_MS: "time_s counts milliseconds",
    LogConvention.TIME_US: "time_s counts microseconds",
    LogConvention.TIME_NS: "time_s counts nanoseconds",
    LogConvention.EAST_NORTH_SWAPPED: "easting and northing are swapped",
    LogConvention.POSITION_DEGREES: "easting_m and northing_m are longitude and latitude in degrees",
    LogConvention.POSITION_KM: "easting_m and northing_m are in kilometres",
    LogConvention.SPEED_KMH: "speeds are in km/h",
    LogConvention.SPEED_MEASURED_KMH: "speed_mps is in km/h",
    LogConvention.SPEED_COMMAND_KMH: "speed_command_mps is in km/h",
    LogConvention.HEADING_RADIANS: "heading_deg is in radians",
    LogConvention.HEADING_CCW_EAST: "heading_deg runs counter-clockwise from east",
    LogConvention.HEADING_CCW_NORTH: "heading_deg runs counter-clockwise from north",
    LogConvention.HEADING_REVERSED: "heading_deg points backwards",
    LogConvention.STEERING_SWAPPED: "steering_command_deg and steering_deg are swapped",
    LogConvention.STEERING_RADIANS: "steering angles are in radians",
    LogConvention.STEERING_LEFT: "steering is positive to the left",
    LogConvention.IMPLEMENT_REVERSED: "implement is 1 where it is lifted and 0 where it works",
    LogConvention.ROLL_LEFT: "roll_deg is positive where the left side is lower",
}


def format_fix_option(fix: LogConvention) -> str:
    """Return the option that applies a fix, for use in a refusal."""
    return f"{mark_parameter('fixes')} {fix}"


@dataclass(frozen=True)
class Suspicion:
    """A convention that the log seems to break, and the evidence.

    `fix` is None when only the log itself can be corrected; `what` and `advice` then say what is suspected and what to
    do. With a fix, `advice` adds the other possible explanations.
    """

    fix: LogConvention | None
    why: str
    what: str = ""
    advice: str = ""

    def format_sentence(self) -> str:
        """Return what is suspected, why, and the fix, for a refusal."""
        if self.fix is None:
            return f"{self.what} ({self.why}); {self.advice}"
        other_readings = f" ({self.advice})" if self.advice else ""
        return f"{FIX_MEANINGS[self.fix]} ({self.why}); give {format_fix_option(self.fix)} to convert{other_readings}"


@dataclass(frozen=True)
class GatedRows:
    """Rows excluded by one rule; `first_line` counts the header as line 1."""

    rule: str
    rows: int
    first_line: int


@dataclass(frozen=True)
class LogFault:
    """Something that breaks during a run: its id, its times in `time_s` (`to_s` None: until the log ends), and what.

    `between_s` are the times between which it began, where these columns do not show when; `from_s` is the middle.
    """

    id: str
    run: str
    from_s: float
    to_s: float | None
    words: str
    between_s: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Log:
    """One run. Arrays have one value per row of the file, in the units of their names; None when a column is absent.

    Every present column except roll and pitch is finite on the rows that are `used`. `segment` numbers the parts
    between gaps of more than five samples, from 0; it is -1 on unused rows. Speeds are never negative (noise down to
    -0.1 m/s counts as 0): the direction is in `shuttle` (-1, 0, 1), which is 1 throughout when the file has no such
    column; `implement` is then 0 throughout. `other_names` are further paths under which the same file was given;
    `corrections` are sentences on instrument errors that were corrected. The measured speed was divided by
    `speed_factor`, the wheel angle by `steering_factor`; `stray_steering_deg` is the standard deviation of a wheel
    angle that was dropped because it is unrelated to the path. Positions and heading were measured in the `fresh` rows
    (None: in all) and are interpolated between them; `place_rows` has the rows of `position` and `heading`, each where
    it is slower than the log; `measured_rows` has the same for other columns that are slower
    than the log. `coarse_columns` are columns that were dropped for their resolution, with the size of their steps.
    `set_remarks` are sentences on the set of logs, carried by one of them; `faults` began during the run, or during one
    that has no row left, and their rows are not used. `elevation_m` are logged heights of the antenna, NaN
    where they are missing. `ground_fall` (n, 2) is the known fall of the ground (m/m) to the east and to the north;
    `ground_source` says, as a plural, where it is known from. `origin_deg` is the longitude and latitude of the origin
    of positions that were logged in degrees.
    """

    name: str
    time_s: Array
    easting_m: Array
    northing_m: Array
    heading_deg: Array | None
    speed_mps: Array | None
    speed_command_mps: Array | None
    steering_command_deg: Array | None
    steering_deg: Array | None
    shuttle: Array
    implement: Array
    roll_deg: Array | None
    pitch_deg: Array | None
    used: Mask
    segment: Rows
    gated: tuple[GatedRows, ...]
    ignored_columns: tuple[str, ...] = ()
    other_names: tuple[str, ...] = ()
    corrections: tuple[str, ...] = ()
    speed_factor: float = 1.0
    steering_factor: float = 1.0
    stray_steering_deg: float = 0.0
    fresh: Mask | None = None
    place_rows: Mapping[str, Mask] = field(default_factory=dict)
    measured_rows: Mapping[str, Mask] = field(default_factory=dict)
    coarse_columns: Mapping[str, float] = field(default_factory=dict)
    set_remarks: tuple[str, ...] = ()
    faults: tuple[LogFault, ...] = ()
    elevation_m: Array | None = None
    ground_fall: Array | None = None
    ground_source: str = ""
    origin_deg: tuple[float, float] | None = None

    @property
    def rows_used(self) -> int:
        """Number of usable rows."""
        return int(np.count_nonzero(self.used))

    @property
    def rows_gated(self) -> int:
        """Number of excluded rows."""
        return len(self.used) - self.rows_used

    @property
    def segment_count(self) -> int:
        """Number of segments between gaps."""
        return int(self.segment.max()) + 1

    @property
    def step_s(self) -> float:
        """Median time between used rows (s)."""
        return float(np.median(np.diff(self.time_s[self.used])))


SHORTEST_SEGMENT_S = 5.0  # one piece of the 5 s horizon, over which errors are compared


def split_drive_segments(log: Log) -> tuple[list[Rows], list[Rows]]:
    """Split a log into segments in one gear without a gap.

    Returns the rows of the segments that are long enough to replay, and the rows of the others.
    """
    long_segments: list[Rows] = []
    short_segments: list[Rows] = []
    rows = np.flatnonzero(log.used)
    # A few excluded rows are no gap, unless the gear changed in them.
    change = (np.diff(log.segment[rows]) != 0) | (np.diff(_number_gear_changes(log)[rows]) != 0)
    for segment_rows in np.split(rows, np.flatnonzero(change) + 1):
        measured_rows = _trim_to_measured(log, segment_rows)
        if len(measured_rows):
            enough = log.time_s[measured_rows[-1]] - log.time_s[measured_rows[0]] >= SHORTEST_SEGMENT_S
            (long_segments if enough else short_segments).append(measured_rows)
    return long_segments, short_segments


def _trim_to_measured(log: Log, rows: Rows) -> Rows:
    """Return the rows from the first to the last in which the position was measured."""
    if log.fresh is None:
        return rows
    fresh = np.flatnonzero(log.fresh[rows])
    return rows[fresh[0] : fresh[-1] + 1] if len(fresh) else rows[:0]


def _number_gear_changes(log: Log) -> Rows:
    """Return the number of logged gear changes up to each row."""
    is_stated = np.isfinite(log.shuttle)
    gear = np.sign(log.shuttle[is_stated])
    number = np.zeros(len(log.shuttle), dtype=np.int64)
    number[is_stated] = np.cumsum(np.diff(gear, prepend=gear[:1]) != 0.0)
    return number


# Units by quantity, the contract's first: how much of the contract's one is, and how else names spell it.
_UNITS: dict[str, dict[str, tuple[float, str]]] = {
    "time": {
        "s": (1.0, "sec,secs,second,seconds,sek,sekunden,secondes,segundos,seconden"), "ms": (1e-3, "msec,millis"),
        "us": (1e-6, "usec"), "ns": (1e-9, "nsec"), "min": (60.0, "minutes,minuten"),
    },
    "length": {
        "m": (1.0, "metre,metres,meter,meters"), "km": (1e3, ""), "cm": (1e-2, ""), "mm": (1e-3, ""),
        "ft": (0.3048, "feet"),
    },
    "speed": {
        "mps": (1.0, "m/s,m_s,m s,ms"), "kmh": (1.0 / 3.6, "km/h,km_h,km h,kph"), "mph": (0.44704, "mi/h"),
        "kn": (1852.0 / 3600.0, "kt,kts,knots"), "cmps": (1e-2, "cm/s"), "mmps": (1e-3, "mm/s"),
    },
    "angle": {
        "deg": (1.0, "degs,degree,degrees,grad,grados,degres,graden"), "rad": (180.0 / math.pi, "radian,radians"),
    },
    "": {},
}  # fmt: skip
_UNIT_BY_SPELLING = {
    quantity: {each: (unit, one) for unit, (one, others) in units.items() for each in {unit, *others.split(",")} - {""}}
    for quantity, units in _UNITS.items()
}
_SPELLINGS = sorted({one for units in _UNIT_BY_SPELLING.values() for one in units}, key=lambda one: (-len(one), one))
_UNIT_AT_END = re.compile(rf"(.*?)(?:[\s_.-]+|[\s_]*[\[(/]+\s*)({'|'.join(map(re.escape, _SPELLINGS))})\s*[\])]*")

TARGETS = {
    "time": ("time_s", "time"), "easting": ("easting_m", "length"), "northing": ("northing_m", "length"),
    "longitude": ("easting_m", "angle"), "latitude": ("northing_m", "angle"), "heading": ("heading_deg", "angle"),
    "speed": ("speed_mps", "speed"), "speed_command": ("speed_command_mps", "speed"),
    "steering": ("steering_deg", "angle"), "steering_command": ("steering_command_deg", "angle"),
    "shuttle": ("shuttle", ""), "implement": ("implement", ""), "roll": ("roll_deg", "angle"),
    "pitch": ("pitch_deg", "angle"), "elevation": ("elevation_m", "length"),
}  # fmt: skip
"""Column of the contract and quantity by what a mapping calls it without a unit; degrees are made metres later."""

# English, German, French, Spanish, Dutch and Japanese; the first ones say nothing of what is measured.
_WORDS = {
    "": "de d du la le of the van del wgs84 gps gnss utm imu pos position positie posicion angle winkel angulo hoek "
    "wert value ist actual measured gemessen mesure mesuree medido gemeten real true ground over sensor current "
    "antenna antenne rtk vehicle fahrzeug tractor traktor tracteur fahr 実測 現在",
    "command": "command cmd commanded soll sollwert vorgabe target setpoint set desired demand reference consigne "
    "consigna objetivo gewenst gewenste ziel 目標 指令 指示",
    "time": "time timestamp stamp datetime zeit zeitstempel uhrzeit t temps horodatage heure tiempo hora tijd tijdstip "
    "utc epoch 時刻 時間",
    "easting": "easting east x e rechtswert ost ostwert est este oost",
    "northing": "northing north y n hochwert nord nordwert norte noord",
    "longitude": "longitude lon lng long lange laenge langengrad laengengrad longitud lengtegraad 経度",
    "latitude": "latitude lat breite breitengrad latitud breedtegraad 緯度",
    "heading": "heading hdg yaw course bearing kurs kurswinkel ausrichtung cap rumbo koers azimut azimuth 方位 方位角",
    "speed": "speed spd velocity vel v sog geschwindigkeit geschwindigkeits tempo vitesse velocidad snelheid 速度 車速",
    "steering": "steering steer wheel delta lenkung lenk lenkwinkel radwinkel lenkeinschlag braquage direccion stuur "
    "stuurhoek volant 操舵 操舵角 ステアリング",
    "shuttle": "shuttle gear fahrstufe wendeschaltung marche inverseur inversor rijrichting 前後進",
    "implement": "implement works working work gerat geraet anbaugerat arbeitsstellung outil travail apero implemento "
    "werktuig 作業 作業機",
    "roll": "roll rollwinkel wankwinkel querneigung roulis balanceo alabeo rol ロール",
    "pitch": "pitch nickwinkel langsneigung laengsneigung tangage cabeceo ピッチ",
    "elevation": "elevation altitude alt height z hohe hoehe altura altitud hoogte 標高 高度",
}
_LIKENESS = 0.85  # chosen, of difflib's: one letter wrong in a short name, and not another word in it
_LONGEST_COMPOUND = 40  # letters: no name is longer, and cutting it up takes ever longer


class Target(NamedTuple):
    """What a mapping calls a column: its column in the contract, and how much of its unit one is (None: not said)."""

    stem: str
    column: str
    quantity: str
    factor: float | None


def parse_target(key: str) -> Target | None:
    """What a key of a mapping means (time_s, time_ms, longitude_deg, shuttle); None for an unknown one."""
    for stem in sorted(TARGETS, key=len, reverse=True):
        column, quantity = TARGETS[stem]
        unit = key.removeprefix(f"{stem}_")
        if key == stem:
            return Target(stem, column, quantity, None)
        if key != unit and unit in _UNIT_BY_SPELLING[quantity]:
            return Target(stem, column, quantity, _UNIT_BY_SPELLING[quantity][unit][1])
    return None


def split_name(name: str) -> tuple[str, str]:
    """The words of a name, without accents and in small letters, and the unit at its end: "v [km/h]" is ("v", "km/h").

    The unit is "" where the name says none.
    """
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name.replace("°", "deg").replace("µ", "u"))
    plain = "".join(one for one in unicodedata.normalize("NFKD", spaced) if not unicodedata.combining(one))
    match = _UNIT_AT_END.fullmatch(plain.strip().casefold())
    return (match[1], match[2]) if match else (plain.casefold(), "")


def find_factor(quantity: str, unit: str) -> float | None:
    """How much of the contract's unit one of a unit is, 1 where none is said; None for a unit of another quantity."""
    return _UNIT_BY_SPELLING[quantity].get(unit, ("", None))[1] if unit else 1.0


def recognise_column(name: str) -> str:
    """What a mapping would call the column of a name, "" where its words or its unit say nothing or two things."""
    words, unit = split_name(name)
    roles = [role for token in re.findall(r"[^\W_]+", words) for role in _find_roles(token)]
    stems = {role for role in roles if role in TARGETS}
    if len(stems) == 1 and None not in roles:
        stem = next(iter(stems)) + ("_command" if "command" in roles else "")
        if stem in TARGETS:
            return _name_target(stem, unit)
    near_names = difflib.get_close_matches(name.strip().lower(), COLUMNS, 1, _LIKENESS)
    return near_names[0] if near_names else ""


def _name_target(stem: str, unit: str) -> str:
    units = _UNIT_BY_SPELLING[TARGETS[stem][1]]
    if unit and unit not in units:
        return ""
    usual = next(iter(units.values()), ("",))[0]
    return f"{stem}_{units[unit][0] if unit else usual}".rstrip("_")


def _find_roles(token: str) -> list[str | None]:
    """What the words of a token mean, a compound (Lenkwinkelsoll) being several; [None] where one is unknown."""
    roles = _list_roles()
    if token in roles:
        return [roles[token]]
    for end in range(len(token) - 1, 0, -1) if len(token) <= _LONGEST_COMPOUND else ():
        head = token[:end]
        if head in roles and (end > 2 or not head.isascii()):
            tail = _find_roles(token[end:])
            if None not in tail and (len(token) - end > 2 or not token.isascii()):
                return [roles[head], *tail]
    return [None]


@cache
def _list_roles() -> dict[str, str]:
    return {split_name(word)[0]: role for role, words in _WORDS.items() for word in words.split()}
