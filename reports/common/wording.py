"""Figures in words, with their units as the reader wants them: durations, counts, prices, areas, lists, clock times.
Effects by their labels: files and JSON have ids, which are shown in brackets where a reader needs them.

Units are metric, or as in the United States (ft, ac, mph, gal). Values are metric everywhere; only screens and pages
show others. JSON, CSV and inputs are always metric.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import TypeVar

from fields.units import DAY_S, FOOT_M, MILE_KM
from reports.common.language import US, get_units, mark_text, translate, translate_count
from reports.common.plan_results import PlanRanking
from vehicle.model.effects import EFFECTS_BY_ID

ACRE_M2 = 4046.8564224
NO_VALUE = "-"
HEADLAND_ORDERS = {"first": mark_text("headland first"), "last": mark_text("headland last")}
_LEAST_ACRES = 0.1  # less is in square feet
LEAST_HA_M2 = 1000.0  # less is in square metres
LEAST_SHARE = 0.005  # less is 0 in whole per cent
SURE_SHARE = 1.0 - LEAST_SHARE  # a probability that is written as 100 % is not said again
LEAST_COST = 0.005  # less reads as nothing
LEAST_WHOLE = 0.5  # of what is printed without decimals: less reads as nothing
SOFT_HYPHEN = "\N{SOFT HYPHEN}"
LEAST_WHOLE_PRICE = 9.995  # from here on costs are printed without decimals
NO_BREAK = "\N{NO-BREAK SPACE}"
_FIGURE = re.compile(r"\d+(?:\.\d+)?")
_IDS = re.compile(rf"\b(?:{'|'.join(EFFECTS_BY_ID)})\b")


@dataclass(frozen=True)
class Quantity:
    """What is measured: its metric unit, that of the United States, and the size of the latter in the former."""

    metric_unit: str
    us_unit: str
    us_size: float

    @property
    def unit(self) -> str:
        """The unit of the reader."""
        return self.us_unit if is_us() else self.metric_unit

    def convert(self, value: float | None) -> float | None:
        """A metric value in the unit of the reader."""
        return value / self.us_size if value is not None and is_us() else value

    def convert_rate(self, rate: float | None) -> float | None:
        """What is counted per metric unit, per unit of the reader."""
        return rate * self.us_size if rate is not None and is_us() else rate

    def format(self, value: float | None, decimals: int = 0) -> str:
        """A metric value with the unit of the reader; a dash where it is missing or not finite."""
        shown = self.convert(value)
        return NO_VALUE if shown is None or not math.isfinite(shown) else f"{shown:.{decimals}f} {self.unit}"


FIELD_AREA = Quantity("ha", "ac", ACRE_M2 / 10_000.0)
SMALL_AREA = Quantity("m2", "ft2", FOOT_M**2)
VOLUME = Quantity("l", "gal", 3.785411784)  # gallons of the United States
LENGTH = Quantity("m", "ft", FOOT_M)
SPEED = Quantity("km/h", "mph", MILE_KM)


def format_width(metres: float) -> str:
    """A working width, without decimals that say nothing: ``3 m`` or ``9.8 ft``."""
    return LENGTH.format(metres, 1) if is_us() else f"{metres:g} m"


def format_speed(speed_kmh: float) -> str:
    """A speed, without decimals that say nothing: ``5 km/h``."""
    return SPEED.format(speed_kmh, 1).replace(".0 ", " ")


def format_area(m2: float | None) -> str:
    """An area in hectares, or in square metres where it is small; in acres or square feet; a dash when not known."""
    least_m2 = _LEAST_ACRES * ACRE_M2 if is_us() else LEAST_HA_M2
    return SMALL_AREA.format(m2) if m2 is None or m2 < least_m2 else FIELD_AREA.format(m2 / 10_000.0, 2)


def is_us() -> bool:
    """Whether the reader wants units of the United States."""
    return get_units() == US


Named = TypeVar("Named")


def format_duration(seconds: float | None) -> str:
    """Seconds as ``h:mm:ss``, always with hours, as 48:53 could be hours; a dash when there is none."""
    if seconds is None or not math.isfinite(seconds):
        return NO_VALUE
    hours, rest = divmod(round_seconds(abs(seconds)), 3600)
    minutes, secs = divmod(rest, 60)
    sign = "-" if seconds <= -0.5 else ""
    return f"{sign}{hours}:{minutes:02d}:{secs:02d}"


def format_minutes(seconds: float | None) -> str:
    """Seconds as the thesis prints them, ``74:35``: minutes without hours; a dash when there is none."""
    if seconds is None or not math.isfinite(seconds):
        return NO_VALUE
    whole_s = round_seconds(abs(seconds))
    return ("-" if seconds <= -0.5 else "") + f"{whole_s // 60}:{whole_s % 60:02d}"


def format_time_span(seconds: float) -> str:
    """Seconds in words: ``22 s``, ``4 min``, ``1 h 5 min``."""
    hours, minutes = divmod(round(seconds / 60.0), 60)
    if seconds < 30.0:
        return translate("{seconds} s", seconds=round(seconds))
    if not hours:
        return translate("{minutes} min", minutes=minutes)
    return translate("{hours} h {minutes} min", hours=hours, minutes=minutes)


def round_seconds(seconds: float) -> int:
    """Whole seconds, halves up."""
    return math.floor(seconds + 0.5)


def round_up_to_minute(seconds: float) -> float:
    """Seconds to the next whole minute, so that what is done by then is done."""
    return 60.0 * math.ceil(round(seconds, 3) / 60.0)


def format_number(value: float | None, decimals: int) -> str:
    """A figure with fixed decimals and no negative zero; a dash when it is missing or not finite."""
    if value is None or not math.isfinite(value):
        return NO_VALUE
    text = f"{value:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0 else text


def format_signed_number(value: float | None, decimals: int) -> str:
    """A figure as `format_number` has it, with a plus where it is above 0 as printed."""
    text = format_number(value, decimals)
    return text if text == NO_VALUE or text.startswith("-") or not float(text) else f"+{text}"


def format_price(value: float | None) -> str:
    """A cost with two decimals, or none from 10 on."""
    return format_number(value, 2 if value is None or abs(value) < LEAST_WHOLE_PRICE else 0)


def format_money(value: float | None, currency: str | None) -> str:
    """A cost with its currency, where that is known."""
    return f"{format_price(value)} {currency or ''}".rstrip()


def format_money_per_area(per_ha: float | None, currency: str | None) -> str:
    """A cost per hectare, in the area unit of the reader: ``34 EUR/ha``."""
    return f"{format_money(FIELD_AREA.convert_rate(per_ha), currency)}/{FIELD_AREA.unit}"


def format_assumed_money(money: str, is_assumed: bool) -> str:
    """An amount, with a word that its prices are assumed where nobody gave them."""
    return translate("{money} (assumed prices)", money=money) if is_assumed else money


def format_risked_money(paid: str, risked: str, risked_cost: float) -> str:
    """What is paid, and beside it what is at risk where that reads as something: nobody pays that."""
    return (
        translate("{paid} paid and {risked} at risk", paid=paid, risked=risked) if risked_cost >= LEAST_COST else paid
    )


def format_price_change(price: float | None, reference: float | None, added: float = 0.0) -> str | None:
    """The difference of two costs as they are printed, with its sign; None where it is printed as none.

    `added` is what the first costs more besides, which is not part of the costs that are printed.
    """
    printed = [format_price(value) for value in (price, reference)]
    if NO_VALUE in printed:
        return None
    decimals = max(len(text.partition(".")[2]) for text in printed)
    change = f"{float(printed[0]) - float(printed[1]) + added:+.{decimals}f}"
    return change if float(change) else None


def format_percent(share: float | None) -> str:
    """A probability in percent, rounded neither to 0 nor to 100; a dash when there is none."""
    if share is not None and SURE_SHARE <= share < 1.0:
        return ">99"
    if share is not None and 0.0 < share < LEAST_SHARE:
        return "<1"
    return format_number(None if share is None else 100.0 * share, 0)


def insert_non_breaking_spaces(text: str) -> str:
    """The text with non-breaking spaces before values and before ha, m2 and %."""
    return re.sub(r"(?<=[a-z:]) (?=\(?\d)|(?<=\d) (?=(?:ha|m2|ac|ft2)\b|%)", NO_BREAK, text)


def format_yes_no(value: bool | None) -> str:
    """``yes``, ``no`` or a dash."""
    return NO_VALUE if value is None else translate("yes") if value else translate("no")


def format_tractor_count(count: int) -> str:
    """``1 tractor``, ``3 tractors``."""
    return translate_count("{count} tractor", "{count} tractors", count)


def join_list(items: Iterable[object], conjunction: str = "and") -> str:
    """``1, 3 and 5``; the conjunction is "and" or "or"."""
    words = [str(item) for item in items]
    if len(words) < 2:
        return words[0] if words else translate("none")
    first, last = ", ".join(words[:-1]), words[-1]
    if conjunction == "or":
        return translate("{items} or {last}", items=first, last=last)
    return translate("{items} and {last}", items=first, last=last)


def parse_start_time(text: str | None) -> datetime | None:
    """A clock time ``08:00`` or a date and time in ISO 8601; None when it is neither."""
    if text is None:
        return None
    for full in (text.strip(), f"2000-01-01T{text.strip()}", f"2000-01-01T0{text.strip()}"):
        try:
            return datetime.fromisoformat(full)
        except ValueError:
            continue
    return None


def has_start_time(ranking: PlanRanking) -> bool:
    """Whether ends of work are clock times."""
    return parse_start_time(ranking.start) is not None


def get_start_time_of_day_s(start: str | None) -> int | None:
    """Seconds of the day at the start; None without one."""
    begin = parse_start_time(start)
    return None if begin is None else 3600 * begin.hour + 60 * begin.minute + begin.second


def format_clock_at(start: str | None, seconds: float) -> str:
    """The clock time ``9:14:05`` some seconds after the start; without a start the seconds as ``h:mm:ss``."""
    begin = get_start_time_of_day_s(start)
    return format_duration(seconds if begin is None else (begin + round_seconds(seconds)) % DAY_S)


def format_clock_after_start(ranking: PlanRanking, seconds: float | None) -> str | None:
    """The clock time ``09:14``, ``01:14 next day`` or ``01:14, 2 days later`` after the start; None without a start."""
    start = parse_start_time(ranking.start)
    if start is None or seconds is None or not math.isfinite(seconds):
        return None
    later = start + timedelta(seconds=round_seconds(seconds))
    days = (later.date() - start.date()).days
    clock = later.strftime("%H:%M")
    return translate_count("{clock} next day", "{clock}, {count} days later", days, clock=clock) if days else clock


def format_end_clock(ranking: PlanRanking, seconds: float) -> str | None:
    """The clock time by which work is done, up to the minute; None without a start."""
    return format_clock_after_start(ranking, round_up_to_minute(seconds))


def format_deadline(ranking: PlanRanking) -> str:
    """When work must be done: the clock time, else the deadline as given or the time there is."""
    return (
        format_clock_after_start(ranking, ranking.allowed_s) or ranking.deadline or format_duration(ranking.allowed_s)
    )


def group_alike(texts: Iterable[tuple[Named, str]]) -> list[list[tuple[Named, str]]]:
    """Texts with what they are of, grouped where they are the same but for their figures; in the order of the first."""
    groups: dict[str, list[tuple[Named, str]]] = {}
    for named, text in texts:
        groups.setdefault(_FIGURE.sub("#", text), []).append((named, text))
    return list(groups.values())


def capitalize_first(text: str) -> str:
    """Text with a capital at its beginning."""
    return text[:1].upper() + text[1:]


def get_effect_label(name: str) -> str:
    """The label of an effect; an id that is not in the catalogue is returned unchanged."""
    if name == "discrepancy_model":
        return "discrepancy model"
    return EFFECTS_BY_ID[name].label if name in EFFECTS_BY_ID else name


def format_effect_with_id(name: str) -> str:
    """Label and id: ``steering offset (steering_offset)``; only once when they are the same."""
    return get_effect_label(name) if get_effect_label(name) == name else f"{get_effect_label(name)} ({name})"


def replace_effect_ids(text: str) -> str:
    """A sentence with every id of an effect replaced by its label."""
    return _IDS.sub(lambda match: get_effect_label(match[0]), text)


def format_effect_values(name: str, values: Mapping[str, float]) -> str:
    """The values of an effect with their units: ``1 deg``; ``0.03 m/m, bearing 90 deg``."""
    if name not in EFFECTS_BY_ID:
        return ", ".join(f"{key} {value:.3g}" for key, value in values.items())
    extra_parameters = {param.name: param for param in EFFECTS_BY_ID[name].optional_params}
    params = {param.name: param for param in EFFECTS_BY_ID[name].params} | extra_parameters
    parts = []
    for key, value in values.items():
        prefix = "" if params[key] is EFFECTS_BY_ID[name].size else f"{key.rpartition('_')[0]} "
        prefix = f"{key.replace('_', ' ')} " if key in extra_parameters else prefix
        parts.append(f"{prefix}{value:.3g} {params[key].unit}".rstrip())
    return ", ".join(parts)
