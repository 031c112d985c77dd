"""Texts of requests as values, and back: times of day, tractor counts, widths, bearings, places, strategies, and what
is wanted of single tracks and headland passes."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from datetime import date, time
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from fields.units import DAY_S, FOOT_M, HOUR_S, KILO, KMH_PER_MPS, MILE_KM, MINUTE_S
from planner.errors import HeadlandError, RequestError, mark_parameter, shorten_value
from strategies.names import STRATEGY_NAMES

if TYPE_CHECKING:
    from strategies.lines.line_wishes import LineName, LineWishes

MAX_TRACTORS = 50
MAX_DIGITS = 40  # nobody types a longer number on purpose
MOST_NAMED = 10_000
MOST_KEPT = 8  # wishes that are read: one request asks for its own many times
_UNITS = {
    "mm": ("m", 0.001), "cm": ("m", 0.01), "centimetres": ("m", 0.01), "m": ("m", 1.0), "metres": ("m", 1.0),
    "km": ("m", KILO), "ft": ("m", FOOT_M), "km/h": ("km/h", 1.0), "kmh": ("km/h", 1.0), "m/s": ("km/h", KMH_PER_MPS),
    "mph": ("km/h", MILE_KM), "kg": ("kg", 1.0), "t": ("kg", KILO), "kw": ("kW", 1.0), "°": ("degrees", 1.0),
    "deg": ("degrees", 1.0), "degrees": ("degrees", 1.0), "%": ("percent", 1.0), "percent": ("percent", 1.0),
    "percentage": ("percent", 1.0), "s": ("s", 1.0), "seconds": ("s", 1.0), "min": ("s", MINUTE_S),
    "minutes": ("s", MINUTE_S), "h": ("s", HOUR_S),
}  # fmt: skip
"""Units as people write them and as the help of options does: what they measure, and how much each is of its unit."""
_NUMBER_WITH_UNIT = re.compile(r"\s*([-+]?\d+(?:[.,]\d+)?)\s*(\S*)\s*")
_LINE_NAMES = re.compile(
    r"(?P<ring>R)?(?P<first>\d{1,5})(?:-(?(ring)R?)(?P<last>\d{1,5})|(?P<piece>[a-z]{1,2})|\.(?P<side>\d{1,4}))?"
)


def format_clock(seconds: float) -> str:
    """Seconds of the day as hh:mm."""
    return f"{int(seconds) // 3600 % 24:02d}:{int(seconds) % 3600 // 60:02d}"


def format_later_clock(start_s: float, elapsed_s: float) -> str:
    """ "17:00", "00:40 next day" or "07:10, 2 days later": the clock so many seconds after another."""
    days, time_s = divmod(start_s + elapsed_s, DAY_S)
    return format_clock(time_s) + {0: "", 1: " next day"}.get(int(days), f", {int(days)} days later")


def format_hours(seconds: float) -> str:
    """ "32:30": hours and minutes, also of more than a day."""
    return f"{int(seconds) // 3600}:{int(seconds) % 3600 // 60:02d}"


def describe_span(start_s: float | None, begin_s: float, end_s: float) -> str:
    """ "is in the field from 08:00 to 13:00": when after its start a plan is; "from 0:00 h" without a start."""
    if start_s is None:
        begin, end = (f"{format_hours(seconds)} h" for seconds in (begin_s, end_s))
    else:
        begin, end = (format_later_clock(start_s, seconds) for seconds in (begin_s, end_s))
    return f"is in the field from {begin} to {end}"


def parse_clock(text: str, parameter: str) -> int:
    """ "13:00" as seconds of the day; raises RequestError that names the parameter."""
    match = re.fullmatch(r"(\d{1,2})(?:(\D?)(\d{2}))?", text.strip())
    hours, minutes = (int(match[1]), int(match[3] or 0)) if match else (13, 0)
    is_time = hours < 24 and minutes < 60
    if not match or match[2] != ":" or not is_time:
        example = f"{hours:02d}:{minutes:02d}" if is_time else "13:00"
        raise RequestError(
            f"{mark_parameter(parameter)} {text!r} is not a time of day; write hh:mm, for instance {example}."
        )
    return hours * 3600 + minutes * 60


def parse_hours(text: str) -> tuple[int, int]:
    """ "08:00-12:00" as seconds of the day (from, to); raises RequestError."""
    match = re.fullmatch(r"\s*(\S+)\s*-\s*(\S+)\s*", text)
    if not match:
        raise RequestError(f"{text!r} is not a range of hours; write for instance '08:00-12:00'.")
    return parse_clock(match[1], "the time"), parse_clock(match[2], "the time")


def write_clock(value: Any, parameter: str) -> str:
    """Seconds of the day as the text of a time of day; anything but a number as it is.

    Raises RequestError for seconds of no day, or within a minute.
    """
    if not isinstance(value, int | float):
        return str(value)
    if not (0 <= value < DAY_S and value % MINUTE_S == 0):
        raise RequestError(
            f"{mark_parameter(parameter)} holds {shorten_value(value)}; give seconds of the day, from 0 to "
            f"{DAY_S - MINUTE_S:.0f}, in whole minutes of {MINUTE_S:.0f}.",
            parameter=parameter,
        )
    return format_clock(value)


def convert_time_to_text(value: Any) -> Any:
    """A time of day or a date as the text that files have for it, also in lists and tuples; other values as they are.

    A pair of times is a range of hours: `[08:00:00, 12:00:00]` in TOML is "08:00-12:00".
    """
    if isinstance(value, time):
        return value.strftime("%H:%M")
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, list | tuple):
        if len(value) == 2 and all(isinstance(each, time) for each in value):
            return "-".join(each.strftime("%H:%M") for each in value)
        return [convert_time_to_text(each) for each in value]
    return value


def convert_clock_to_seconds(value: Any, parameter: str) -> Any:
    """A time of day, or its text "13:00", as seconds of the day; other values as they are.

    Raises RequestError for a text that is no time of day, and for a time with a time zone.
    """
    if isinstance(value, str):
        return parse_clock(value, parameter)
    if not isinstance(value, time):
        return value
    if value.tzinfo is not None:
        raise RequestError(
            f"{mark_parameter(parameter)} {value.isoformat()} has a time zone; give the local time of the field, such "
            f"as {value.replace(tzinfo=None, microsecond=0).isoformat('minutes')}."
        )
    return value.hour * 3600 + value.minute * 60 + value.second


def parse_counts(text: str) -> tuple[int, ...]:
    """ "1-6", "3" or "1,3,5-7" as sorted counts; raises RequestError."""
    counts: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(rf"\s*(\d{{1,{MAX_DIGITS}}})\s*(?:-\s*(\d{{1,{MAX_DIGITS}}})\s*)?", part)
        if not match:
            text = text if len(text) <= MAX_DIGITS else text[:MAX_DIGITS] + "..."
            raise RequestError(
                f"{mark_parameter('tractors')} {text!r} is not a count; write for instance 3, 1-6 or 1,3,5."
            )
        low, high = int(match[1]), int(match[2] or match[1])
        if low > high:
            raise RequestError(f"{mark_parameter('tractors')} {part.strip()!r} runs backwards; write {high}-{low}.")
        if high > MAX_TRACTORS:
            raise RequestError(f"{high} tractors cannot be planned; use 1 to {MAX_TRACTORS}.", parameter="tractors")
        counts.update(range(low, high + 1))
    return tuple(sorted(counts))


def suggest_number(text: str, option_help: str) -> str:
    """ " (write it in metres: 0.3)" for "30cm" where a help has metres, " (write 4.5)" for "4,5"; "" for no number."""
    found = _NUMBER_WITH_UNIT.fullmatch(text)
    if found is None:
        return ""
    number, unit = float(found[1].replace(",", ".")), found[2].lower()
    if not unit:
        return f" (write {number:g})"
    wanted = next((word for word in re.split(r"[\s,;.]+", option_help) if word.lower() in _UNITS and len(word) > 1), "")
    measured, size = _UNITS.get(unit, ("", 0.0))
    if not wanted or measured != _UNITS[wanted.lower()][0]:
        return ""
    return f" (write it in {wanted}: {number * size / _UNITS[wanted.lower()][1]:g})"


def parse_widths(text: str, show_remark: Callable[[str], None] = lambda remark: None) -> tuple[float, ...]:
    """ "3" or "3,6" as widths in metres, each once, in the order given; raises RequestError.

    `show_remark` is called with a sentence on what may be one number with a decimal comma.
    """
    widths: dict[float, None] = {}
    for part in text.split(","):
        if not re.fullmatch(rf"\s*[-+]?(\d{{1,{MAX_DIGITS}}}(\.\d*)?|\.\d+)(e[-+]?\d{{1,3}})?\s*", part, re.I):
            raise RequestError(
                f"{mark_parameter('width_m')} {shorten_value(text)} is not a width{suggest_number(part, 'metres')}; "
                "write metres, such as 3 or 3,6."
            )
        widths[float(part)] = None
    if remark := _question_comma(text):
        show_remark(remark)
    return tuple(widths)


def _question_comma(text: str) -> str:
    """A sentence on a list of two whole numbers, which may be one with a decimal comma; "" for any other."""
    if not re.fullmatch(r"\d+,\d+", text):
        return ""
    first, second = text.split(",")
    return f"{text} are two widths, {first} m and {second} m; write {first}.{second} for one."


def parse_cell_bearings(texts: Iterable[str]) -> tuple[tuple[int, float], ...]:
    """ "2=45" and more as cells and degrees, the last of a cell counts; raises RequestError."""
    bearings: dict[int, float] = {}
    for text in texts:
        match = re.fullmatch(rf"\s*(\d{{1,{MAX_DIGITS}}})\s*=\s*([-+]?\d{{1,{MAX_DIGITS}}}(?:\.\d*)?)\s*", text)
        if not match:
            raise RequestError(
                f"{mark_parameter('cell_bearings')} {shorten_value(text)} is not a cell with its bearing; write for "
                "instance 2=45."
            )
        bearings[int(match[1])] = float(match[2])
    return tuple(sorted(bearings.items()))


def parse_number_pair(text: str, parameter: str) -> tuple[float, float]:
    """ "9.53,56.21" as two numbers; raises RequestError that names the parameter."""
    try:
        first, second = (float(part) for part in text.split(","))
    except ValueError:
        raise RequestError(
            f"{mark_parameter(parameter)} {shorten_value(text)} is not a place; write longitude and latitude, for "
            "instance 9.53,56.21."
        ) from None
    return first, second


def parse_strategies(text: str) -> tuple[str, ...]:
    """ "all" of Headland's, or names with commas, each once and in their order; PlanRequest refuses unknown ones."""
    if text.strip() == "all":
        return STRATEGY_NAMES
    return tuple(dict.fromkeys(name.strip() for name in text.split(",")))


@lru_cache(maxsize=MOST_KEPT)
def read_line_wishes(leave_out: str | None, work_first: str | None, give: tuple[str, ...]) -> LineWishes:
    """The wishes of `leave_out` ("3,7-9"), `work_first` ("12,11") and `give` ("2=5-8"); raises HeadlandError."""
    from strategies.lines.line_wishes import LineName, LineWishes

    out, first = (
        () if text is None else parse_line_names(text, parameter)
        for text, parameter in ((leave_out, "leave_out"), (work_first, "work_first"))
    )
    given, named = list[tuple[int, tuple[LineName, ...]]](), list[LineName]()
    for text in give:
        # "2=5-8" is a tractor and its lines.
        tractor, is_given, names = text.partition("=")
        number = int(tractor) if tractor.strip().isdecimal() and len(tractor.strip()) < 4 else 0
        if not is_given or number < 1:
            raise HeadlandError(
                f"{mark_parameter('give')} {shorten_value(text)} is not a tractor with its tracks; write for "
                "instance 2=5-8.",
                parameter="give",
            )
        given.append((number, parse_line_names(names, "give")))
        named += given[-1][1]
        _check_number(named, "give")
    left_out = frozenset(out)
    taken = set(left_out)
    for twice in sorted(named, key=lambda one: one.piece is not None):  # a piece after its whole
        if not taken.isdisjoint((twice, twice.whole)):
            raise HeadlandError(
                f"{twice} is named twice in {mark_parameter('leave_out')} and {mark_parameter('give')}; name it once.",
                parameter="give",
            )
        taken.add(twice)
    idle = next((name for name in first if not left_out.isdisjoint((name, name.whole))), None)
    if idle is not None:
        raise HeadlandError(
            f"{idle} is left out and worked first; take it from {mark_parameter('leave_out')} or "
            f"{mark_parameter('work_first')}.",
            parameter="leave_out",
        )
    return LineWishes(out, first, tuple(given))


def parse_line_names(text: str, parameter: str) -> tuple[LineName, ...]:
    """Names of tracks, a range of them, a piece, a headland pass, one of its sides: "3,7-9,5b,R1,R2.4".

    Raises HeadlandError, also for more than any layout has.
    """
    from strategies.lines.line_wishes import LineName
    from vehicle.missions.plan import HEADLAND_PASS, SWATH

    names = list[LineName]()
    for part in text.split(","):
        found = _LINE_NAMES.fullmatch(part.strip())
        last = found and int(found["last"] or found["first"])
        # Tracks have pieces and headland passes sides, both counted from 1.
        is_wrong = found and (found["piece" if found["ring"] else "side"] or found["side"] == "0")
        if found is None or last is None or is_wrong or not 1 <= int(found["first"]) <= last <= MOST_NAMED:
            raise HeadlandError(
                f"{mark_parameter(parameter)} holds {shorten_value(part)}, which names no track; write tracks and "
                "headland passes as the map does, for instance 3,7-9,5b,R1.",
                parameter=parameter,
            )
        kind = HEADLAND_PASS if found["ring"] else SWATH
        piece = int(found["side"]) - 1 if found["side"] else None
        for letter in found["piece"] or "":
            piece = 26 * (0 if piece is None else piece + 1) + ord(letter) - ord("a")
        first = int(found["first"])
        names += [LineName(kind, number, piece, first < number < last) for number in range(first, last + 1)]
        _check_number(names, parameter)
    return tuple(dict.fromkeys(names))


def _check_number(names: Sequence[LineName], parameter: str) -> None:
    """Raise HeadlandError for more names than any layout has lines."""
    if len(names) > MOST_NAMED:
        raise HeadlandError(
            f"{mark_parameter(parameter)} names more than {MOST_NAMED:,} tracks; name those of the map only.",
            parameter=parameter,
        )
