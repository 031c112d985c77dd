"""When rain begins, in seconds after the planned start: forecasts in several formats, and samples from them."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from datetime import datetime, time
from pathlib import Path

import numpy as np

from fields.arrays import Floats
from fields.text_files import parse_number, parse_table, read_table_text
from fields.units import DAY_S, HOUR_S, PCT
from planner.errors import RequestError, mark_parameter, shorten_value
from planner.request.option_texts import parse_clock
from planner.risk.random_events import create_generator

MAX_HOURS = 1000.0
MAX_MEMBERS = 100_000
RAIN_FORMATS = "a time (17:00), times with percentages (16:30=20,17:00=50,18:00=30), a rate (0.2/h) or a CSV file"


@dataclass(frozen=True)
class RainForecast:
    """Rain begins at one of `onsets_s` with these probabilities (the remainder to 1 is dry), or at a rate.

    A rate above 0 means an exponential distribution; `onsets_s` is then empty.
    """

    onsets_s: tuple[float, ...] = ()
    probabilities: tuple[float, ...] = ()
    rate_per_s: float = 0.0

    @property
    def certain_onset_s(self) -> float | None:
        """When rain begins, where that is certain and its time known; else None."""
        return self.onsets_s[0] if len(self.onsets_s) == 1 and sum(self.probabilities) == 1.0 else None

    def draw_onsets(self, samples: int, seed: int) -> Floats:
        """Onsets (samples,), infinite where it stays dry; the same for all plans with one seed."""
        generator = create_generator(seed, "rain")
        if self.rate_per_s > 0.0:
            return generator.exponential(1.0, samples) / self.rate_per_s
        uniforms = generator.random(samples)
        order = np.argsort(self.onsets_s, kind="stable")
        edges = np.cumsum(np.array(self.probabilities)[order])
        times = np.append(np.array(self.onsets_s)[order], math.inf)
        # Probabilities that sum to 1 may round below it: no sample may fall beyond them.
        edges = np.where(edges > 1.0 - 1e-9, 1.0, edges)
        return np.asarray(times[np.searchsorted(edges, uniforms, side="right")])


def parse_rain(text: str, start_s: int | None) -> RainForecast:
    """Rain in one of RAIN_FORMATS; `start_s` is the planned start, seconds of the day. Raises RequestError.

    A time of day that is not after the start is on the next day. A file has one row per member of an ensemble, all
    equally likely: a column `time` (hh:mm, or a date with a time) or `hours` after the start; `dry` or an empty cell
    for a dry member.
    """
    text = text.strip()
    rate = re.fullmatch(r"([0-9.eE+-]+)\s*/\s*h", text)
    if rate:
        return RainForecast(rate_per_s=_parse_number(rate[1], "rate", shorten_value(text)) / HOUR_S)
    if re.fullmatch(r"\d{1,2}:\d{2}", text):
        return RainForecast((_compute_onset_s(text, start_s),), (1.0,))
    if "=" in text:
        onsets_s, probabilities = [], []
        for part in text.split(","):
            clock_text, _, share = part.partition("=")
            onsets_s.append(_compute_onset_s(clock_text.strip(), start_s))
            probabilities.append(
                _parse_number(share.strip().removesuffix("%"), "percentage", shorten_value(part)) / PCT
            )
        total = PCT * sum(probabilities)
        if not 0.0 < total <= PCT + 1e-6:
            raise RequestError(
                f"{mark_parameter('rain')} percentages add up to {total:g}; they must add up to 100, or less if it may "
                "stay dry."
            )
        return RainForecast(tuple(onsets_s), tuple(probabilities))
    if not text.lower().endswith(".csv"):
        raise RequestError(f"{mark_parameter('rain')} {shorten_value(text)} is none of: {RAIN_FORMATS}.")
    return parse_ensemble(read_table_text(Path(text), "a CSV file", RequestError), shorten_value(text), start_s)


def parse_ensemble(text: str, file_name: str, start_s: int | None) -> RainForecast:
    """Rain from the text of a CSV file as in `parse_rain`; `file_name` names it in refusals."""
    table = parse_table(text, f"{mark_parameter('rain')} file {file_name}", RequestError, keeps_empty=True)
    # The csv module skips an empty line in a single column: it may mean a dry member or nothing.
    head, *lines = text.splitlines() or [""]
    for number, line in enumerate(lines, 2):
        if "," not in head and not line.strip():
            raise RequestError(
                f"{mark_parameter('rain')} file {file_name} is empty in line {number}; write dry there for a member "
                "without rain, or delete the line."
            )
    column = table.find_column(("time", "hours"))
    if column is None:
        raise RequestError(f"{table.label} has no column of times; give it a header with time (hh:mm) or hours.")
    onsets_s, count = [], len(table.rows)
    for row, value in enumerate(table.list_cells(column)):
        if value.lower() in ("", "dry"):
            continue
        if column.lower() == "hours":
            onsets_s.append(table.parse_amount(row, column, MAX_HOURS) * HOUR_S)
        else:
            onsets_s.append(_parse_member(value, table.describe_cell(row, column), start_s))
    if not onsets_s or count > MAX_MEMBERS:
        raise RequestError(
            f"{table.label} has {count} members, {len(onsets_s)} of them with rain; give 1 to {MAX_MEMBERS} rows, at "
            "least one of them with a time."
        )
    return RainForecast(tuple(onsets_s), (1.0 / count,) * len(onsets_s))


def _compute_onset_s(text: str, start_s: int | None) -> float:
    """Seconds from the start to a time of day."""
    seconds = parse_clock(text, "rain")
    if start_s is None:
        raise RequestError(
            f"{mark_parameter('rain')} at {text} needs a start; give {mark_parameter('start_s')} as well.",
            parameter="start_s",
        )
    return float((seconds - start_s) % DAY_S or DAY_S)


def _parse_member(value: str, described: str, start_s: int | None) -> float:
    """Seconds from the start to the time in a row; the day of a date is ignored."""
    match = re.fullmatch(r"(\d{1,2}):(\d{2})", value)
    try:
        moment = time(int(match[1]), int(match[2])) if match else datetime.fromisoformat(value)
    except ValueError:
        raise RequestError(f"{described}; write hh:mm or 2025-05-01T17:00, or dry for a member without rain.") from None
    return _compute_onset_s(f"{moment.hour:02d}:{moment.minute:02d}", start_s)


def _parse_number(value: str, quantity: str, location: str) -> float:
    """A number that is not negative."""
    number = parse_number(value)
    upper_limit = MAX_HOURS if quantity != "percentage" else PCT
    if not 0.0 <= number <= upper_limit:
        raise RequestError(
            f"{mark_parameter('rain')} has the {quantity} {shorten_value(value)} in {location}; give a number from 0 "
            f"to {upper_limit:g}."
        )
    return number
