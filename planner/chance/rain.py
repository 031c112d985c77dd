"""When it begins to rain, in seconds after the planned start of work: what may be said of it, and draws from that."""

from __future__ import annotations

import csv
import io
import math
import re
from dataclasses import dataclass
from datetime import datetime, time
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fields.reading import brief, read_text
from planner.chance.streams import stream
from planner.errors import ScenarioError, named
from planner.scenario import DAY_S, parse_clock

HOUR_S = 3600.0
MOST_HOURS = 1000.0
MOST_MEMBERS = 100_000
WHOLE_PCT = 100.0
FORMS = "a time (17:00), times with percentages (16:30=20,17:00=50,18:00=30), a rate (0.2/h) or a CSV file"
Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Rain:
    """Rain begins at one of `onset_s` with these `shares`, what is missing to 1 is no rain; or at a rate per second.

    A rate above 0 is the exponential law and leaves `onset_s` empty.
    """

    onset_s: tuple[float, ...] = ()
    shares: tuple[float, ...] = ()
    per_s: float = 0.0

    def draw(self, draws: int, seed: int) -> Array:
        """Onsets (draws,); infinite where it stays dry. The same for every plan of one seed."""
        if self.per_s > 0.0:
            return stream(seed, "rain").exponential(1.0, draws) / self.per_s
        luck = stream(seed, "rain").random(draws)
        order = np.argsort(self.onset_s, kind="stable")
        edges = np.cumsum(np.array(self.shares)[order])
        times = np.append(np.array(self.onset_s)[order], math.inf)
        # Shares that are all of it add up to 1 but for rounding: then no draw may fall beyond them.
        edges = np.where(edges > 1.0 - 1e-9, 1.0, edges)
        return np.asarray(times[np.searchsorted(edges, luck, side="right")])


def parse_rain(text: str, start_s: int | None) -> Rain:
    """Rain in one of `FORMS`; `start_s` is the planned start, seconds of the day. Raises ScenarioError.

    A clock time that is not after the start is on the next day. A file has one row per member of an ensemble, all
    as likely: a column `time` (hh:mm, or a date with a time) or `hours` after the start; `dry`, or an empty cell, for
    a dry one.
    """
    text = text.strip()
    rate = re.fullmatch(r"([0-9.eE+-]+)\s*/\s*h", text)
    if rate:
        return Rain(per_s=_number(rate[1], "rate", brief(text)) / HOUR_S)
    if re.fullmatch(r"\d{1,2}:\d{2}", text):
        return Rain((_after(text, start_s),), (1.0,))
    if "=" in text:
        return _with_percentages(text, start_s)
    if not text.lower().endswith(".csv"):
        raise ScenarioError(f"{named('rain')} {brief(text)} is none of: {FORMS}.")
    return members(read_text(Path(text), "a CSV file", ScenarioError), brief(text), start_s)


def members(text: str, called: str, start_s: int | None) -> Rain:
    """Rain from the text of a CSV file as `parse_rain` describes it; `called` names it in refusals."""
    _refuse_empty_line(text, called)
    rows = csv.DictReader(io.StringIO(text.removeprefix("\ufeff")))
    names = {(name or "").strip().lower(): name for name in rows.fieldnames or ()}
    column = next((name for name in ("time", "hours") if name in names), None)
    if column is None:
        raise ScenarioError(
            f"{named('rain')} file {called} has no column of times; give it a header with time (hh:mm) or hours."
        )
    onsets, dry = [], 0
    for row in rows:
        value = (row[names[column]] or "").strip()
        at = f"row {rows.line_num} of {called}"
        if value.lower() in ("", "dry"):
            dry += 1
        elif column == "hours":
            onsets.append(_number(value, "hours", at) * HOUR_S)
        else:
            onsets.append(_member(value, at, start_s))
    count = len(onsets) + dry
    if not onsets or count > MOST_MEMBERS:
        raise ScenarioError(
            f"{named('rain')} file {called} has {count} members, {len(onsets)} of them with rain; give 1 to "
            f"{MOST_MEMBERS} rows, one with a time at least."
        )
    return Rain(tuple(onsets), (1.0 / count,) * len(onsets))


def _refuse_empty_line(text: str, called: str) -> None:
    """An empty line of one column may be a dry member or nothing: csv skips it, so the file has to say."""
    head, *lines = text.splitlines() or [""]
    for number, line in enumerate(lines, 2):
        if "," not in head and not line.strip():
            raise ScenarioError(
                f"{named('rain')} file {called} is empty in line {number}; write dry there for a member without rain, "
                "or take the line out."
            )


def _with_percentages(text: str, start_s: int | None) -> Rain:
    onsets, shares = [], []
    for part in text.split(","):
        at, _, share = part.partition("=")
        onsets.append(_after(at.strip(), start_s))
        shares.append(_number(share.strip().removesuffix("%"), "percentage", brief(part)) / WHOLE_PCT)
    total = WHOLE_PCT * sum(shares)
    if not 0.0 < total <= WHOLE_PCT + 1e-6:
        raise ScenarioError(
            f"{named('rain')} percentages add up to {total:g}; give 100 together, or less where it may stay dry."
        )
    return Rain(tuple(onsets), tuple(shares))


def _after(text: str, start_s: int | None) -> float:
    """Seconds from the start to a clock time."""
    seconds = parse_clock(text, "rain")
    if start_s is None:
        raise ScenarioError(
            f"{named('rain')} at {text} needs a start; give {named('start_s')} as well.", parameter="start_s"
        )
    return float((seconds - start_s) % DAY_S or DAY_S)


def _member(value: str, at: str, start_s: int | None) -> float:
    """Seconds from the start to the time of a row; of a date only the time of day counts."""
    match = re.fullmatch(r"(\d{1,2}):(\d{2})", value)
    try:
        moment = time(int(match[1]), int(match[2])) if match else datetime.fromisoformat(value)
    except ValueError:
        raise ScenarioError(
            f"{named('rain')} has the time {brief(value)} in {at}; write hh:mm or 2025-05-01T17:00, or dry for "
            "a member without rain."
        ) from None
    return _after(f"{moment.hour:02d}:{moment.minute:02d}", start_s)


def _number(value: str, what: str, where: str) -> float:
    """A number that is not negative."""
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    most = MOST_HOURS if what != "percentage" else WHOLE_PCT
    if not 0.0 <= number <= most:
        raise ScenarioError(
            f"{named('rain')} has the {what} {brief(value)} in {where}; give a number from 0 to {most:g}."
        )
    return number
