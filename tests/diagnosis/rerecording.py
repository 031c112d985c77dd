"""The same drives written down another way, and whether a diagnosis says the same of both.

A flip is another verdict: a named effect is replaced or refuted, a name comes in that was not told before, or a value
leaves both intervals. A loss is a name that is told less surely, or not at all, with nothing put in its place.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from tests.truth.effects import PLACES

VARIATIONS = ("10 Hz", "5 Hz", "2 Hz", "held", "interpolated", "jitter")
"""Rates; steering columns refreshed every one or two seconds, repeated in between or drawn as lines; stamps."""
HELD_COLUMNS, HOLD_S, JITTER_S = ("steering_command_deg", "steering_deg"), (1.0, 2.0), 0.035
NAMED, LIKELY, EQUIVALENT, REFUTED = "named", "likely", "equivalent", "refuted"
TOLD = (NAMED, LIKELY, EQUIVALENT)
Record = dict[str, Any]


def vary_logs(frames: Sequence[pd.DataFrame], how: str) -> list[pd.DataFrame]:
    """The same logs at a lower rate (`5 Hz`), with steering columns held or interpolated, or with a clock that jitters.

    Raises ValueError for a way not in VARIATIONS.
    """
    if how not in VARIATIONS:
        raise ValueError(f"Logs cannot be varied by {how!r}; use one of: {', '.join(VARIATIONS)}.")
    return [_vary_log(frame, how) for frame in frames]


def _vary_log(frame: pd.DataFrame, how: str) -> pd.DataFrame:
    name, time_s = frame.attrs["name"], frame["time_s"].to_numpy(float)
    rng = np.random.default_rng(len(frame))
    if how.endswith("Hz"):
        out = _thin_rows(frame, time_s, float(how.split()[0]))
    elif how == "jitter":
        jitter = JITTER_S * np.clip(rng.standard_normal(len(frame)), -2.5, 2.5)
        out = frame.assign(time_s=np.round(_keep_increasing(time_s + jitter), 3))
    else:
        out = _hold_columns(frame, time_s, rng, how == "interpolated")
    out.attrs["name"] = name
    return out


def _thin_rows(frame: pd.DataFrame, time_s: np.ndarray, rate_hz: float) -> pd.DataFrame:
    """Rows at most this often; logs of this rate or slower stay as they are."""
    if np.median(np.diff(time_s)) > 0.95 / rate_hz:
        return frame.copy()
    numbers = np.floor((time_s - time_s[0]) * rate_hz + 0.3)
    _, first = np.unique(numbers, return_index=True)
    return frame.iloc[first].reset_index(drop=True)


def _keep_increasing(time_s: np.ndarray) -> np.ndarray:
    """Times (k,) of which none is before the last; those that would be follow a millisecond later."""
    out = time_s.copy()
    for i in range(1, len(out)):
        out[i] = max(out[i], out[i - 1] + 0.002)
    return out


def _hold_columns(
    frame: pd.DataFrame, time_s: np.ndarray, rng: np.random.Generator, interpolated: bool
) -> pd.DataFrame:
    """Steering columns refreshed together every HOLD_S (drawn), repeated in between or drawn from one to the next."""
    gaps = rng.uniform(*HOLD_S, int((time_s[-1] - time_s[0]) / HOLD_S[0]) + 2)
    beats = time_s[0] + np.concatenate([[0.0], np.cumsum(gaps)])
    first = np.unique(np.searchsorted(time_s, beats[beats <= time_s[-1]] - 1e-6))
    number = np.searchsorted(first, np.arange(len(time_s)), side="right") - 1
    out = frame.copy()
    for name in HELD_COLUMNS:
        if name in frame:
            values = frame[name].to_numpy(float)[first]
            out[name] = np.interp(time_s, time_s[first], values) if interpolated else values[number]
    return out


def is_as_recorded(frames: Sequence[pd.DataFrame], how: str) -> bool:
    """Whether a rate leaves logs as they are, because they have no more rows a second."""
    return how.endswith("Hz") and all(
        len(_thin_rows(frame, frame["time_s"].to_numpy(float), float(how.split()[0]))) == len(frame) for frame in frames
    )


def find_said(record: Mapping[str, Any], name: str) -> Record:
    """What was said of an effect; an empty status where nothing was."""
    empty: Record = {"id": name, "status": "", "interval": None, "value": None, "law": None, "equivalent_to": []}
    return next((one for one in record["said"] if one["id"] == name), empty)


def list_flips(base: Record, varied: Record) -> list[str]:
    """Names that another way of writing down the same logs brings in, refutes, or moves beyond both intervals.

    A name that comes in is right where it was told before, or may rightly be said of the case (`allowed`).
    """
    flips = [str(varied["error"])] if "error" in varied else []
    for name in varied["named"]:
        was, now = find_said(base, name), find_said(varied, name)
        if was["status"] not in TOLD and name not in base.get("allowed", ()):
            flips.append(f"{name} {describe_said(now)} was {was['status'] or 'not said'}")
    for name in {one["id"] for one in base["said"] if one["status"] in (NAMED, LIKELY)}:
        was, now = find_said(base, name), find_said(varied, name)
        if now["status"] in (NAMED, LIKELY) and is_moved(was, now):
            flips.append(f"{name} {describe_said(was)} -> {describe_said(now)}")
    return flips + [f"{name} refuted" for name in base["named"] if find_said(varied, name)["status"] == REFUTED]


def list_losses(base: Record, varied: Record) -> list[str]:
    """Names that are only likely or equivalent, or not told, in another way of writing down the same logs."""
    if "error" in varied:
        return []
    statuses = {name: find_said(varied, name)["status"] for name in base["named"]}
    return [f"{name} {status or 'not said'}" for name, status in statuses.items() if status not in (NAMED, REFUTED)]


def is_moved(was: Record, now: Record) -> bool:
    """Whether a value has left both intervals, in any parameter but places; false where one is missing."""
    if not (was["interval"] and now["interval"] and was["value"] and now["value"]):
        return False
    keys = [key for key in was["interval"] if key in now["interval"] and key not in PLACES]
    kept = [
        _holds(was["interval"][key], now["value"].get(key)) or _holds(now["interval"][key], was["value"].get(key))
        for key in keys
    ]
    return not all(kept)


def _holds(interval: Sequence[float | None], value: float | None) -> bool:
    low, high = interval
    return value is None or ((low is None or low <= value) and (high is None or value <= high))


def describe_said(said: Record) -> str:
    """Value and interval of an effect as they were said; empty without."""
    if not said["value"]:
        return ""
    key = next((key for key in said["value"] if key not in PLACES), next(iter(said["value"])))
    low, high = (said["interval"] or {}).get(key, (None, None))
    numbers = ["?" if number is None else f"{number:.3g}" for number in (said["value"][key], low, high)]
    return f"{numbers[0]} [{numbers[1]}, {numbers[2]}]"
