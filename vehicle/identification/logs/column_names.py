"""What columns under other names may hold: units and words of people's logs in several languages."""

from __future__ import annotations

import difflib
import math
import re
import unicodedata
from functools import cache
from typing import NamedTuple

from vehicle.identification.logs.schema import COLUMNS

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
