"""What the user asks for, validated before anything is simulated."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from planner.errors import ScenarioError, nearest
from strategies.registry import STRATEGIES
from strategies.turns import TURN_KINDS

MOST_TRACTORS = 50
KMH = 1.0 / 3.6
SLOWEST_KMH = 0.5
DEFAULT_SPEED_MPS = 5.0 * KMH  # thesis, section 6.3.1


@dataclass(frozen=True)
class Scenario:
    """A field, a fleet and a question. Lengths in metres, speeds in m/s, clock times in seconds of the day."""

    field: str
    local: bool = False
    width_m: float = 3.0
    headland_m: float | None = None
    bearing_deg: float | None = None
    radius_m: float | None = None
    tractor: str = "eg105"
    tractors: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    strategies: tuple[str, ...] = tuple(STRATEGIES)
    turn: str = "auto"
    speed_mps: float = DEFAULT_SPEED_MPS
    turn_speed_mps: float = DEFAULT_SPEED_MPS
    price_per_hour: float = 40.0
    price_per_tractor: float = 0.0
    start_s: int | None = None
    before_s: int | None = None
    seed: int = 1
    gnss: bool = False
    gnss_table: str | None = None

    def __post_init__(self) -> None:
        _check_fleet(self)
        _check_names(self)
        _check_numbers(self)

    @property
    def allowed_s(self) -> float | None:
        """Seconds from start to deadline, None without a deadline."""
        return None if self.before_s is None else float(self.before_s - (self.start_s or 0))


def _check_fleet(scenario: Scenario) -> None:
    if not scenario.tractors:
        raise ScenarioError("No tractor count is given; use for instance --tractors 1-6.")
    for count in scenario.tractors:
        if not 1 <= count <= MOST_TRACTORS:
            raise ScenarioError(f"{count} tractors cannot be planned; use 1 to {MOST_TRACTORS}.")


def _check_names(scenario: Scenario) -> None:
    if not scenario.strategies:
        raise ScenarioError(f"No strategy is given; use one or more of: {', '.join(STRATEGIES)}.")
    for name in scenario.strategies:
        if name not in STRATEGIES:
            raise ScenarioError(f"Strategy {name!r} is unknown{nearest(name, STRATEGIES)}; use one of: "
                                f"{', '.join(STRATEGIES)}.")  # fmt: skip
    if scenario.turn not in ("auto", *TURN_KINDS):
        raise ScenarioError(f"Turn {scenario.turn!r} is unknown{nearest(scenario.turn, ('auto', *TURN_KINDS))}; "
                            f"use auto, {', '.join(TURN_KINDS)}.")  # fmt: skip


def _check_numbers(scenario: Scenario) -> None:
    positive = {
        "working width (--width)": scenario.width_m,
        "speed (--speed-kmh)": scenario.speed_mps / KMH,
        "turn speed (--turn-speed-kmh)": scenario.turn_speed_mps / KMH,
        "headland (--headland)": scenario.headland_m,
        "turning radius (--radius)": scenario.radius_m,
    }
    for name, value in positive.items():
        if value is not None and not (math.isfinite(value) and value > 0):
            raise ScenarioError(f"The {name} is {value:g}; it must be above 0.")
    if min(scenario.speed_mps, scenario.turn_speed_mps) < SLOWEST_KMH * KMH * (1 - 1e-9):
        raise ScenarioError(
            f"A speed of {min(scenario.speed_mps, scenario.turn_speed_mps) / KMH:g} km/h is slower than a tractor "
            f"creeps; use {SLOWEST_KMH:g} km/h or more."
        )
    if scenario.seed < 0:
        raise ScenarioError(f"The seed is {scenario.seed}; use 0 or more.")
    if max(scenario.speed_mps, scenario.turn_speed_mps) > 30 * KMH:
        raise ScenarioError(
            f"A speed of {max(scenario.speed_mps, scenario.turn_speed_mps) / KMH:g} km/h is beyond field work; "
            "use 30 km/h or less."
        )
    if scenario.bearing_deg is not None and not math.isfinite(scenario.bearing_deg):
        raise ScenarioError(f"The bearing is {scenario.bearing_deg}; give degrees clockwise from north.")
    prices = {"--price-per-hour": scenario.price_per_hour, "--price-per-tractor": scenario.price_per_tractor}
    for name, price in prices.items():
        if not (math.isfinite(price) and price >= 0):
            raise ScenarioError(f"{name} is {price:g}; a price must be 0 or more.")
    if scenario.before_s is not None and scenario.start_s is None:
        raise ScenarioError("A deadline (--before) needs a start; add --start, for instance --start 13:00.")
    allowed = scenario.allowed_s
    if allowed is not None and allowed <= 0:
        raise ScenarioError(
            f"The deadline {clock(scenario.before_s or 0)} is not after the start {clock(scenario.start_s or 0)}; "
            "give a later --before."
        )


def clock(seconds: float) -> str:
    """Seconds of the day as hh:mm."""
    return f"{int(seconds) // 3600 % 24:02d}:{int(seconds) % 3600 // 60:02d}"


def parse_clock(text: str, option: str) -> int:
    """ "13:00" as seconds of the day; raises ScenarioError."""
    match = re.fullmatch(r"(\d{1,2}):(\d{2})", text.strip())
    if not match or int(match[1]) > 23 or int(match[2]) > 59:
        raise ScenarioError(f"{option} {text!r} is not a time of day; write hh:mm, for instance 13:00.")
    return int(match[1]) * 3600 + int(match[2]) * 60


def parse_counts(text: str) -> tuple[int, ...]:
    """ "1-6", "3" or "1,3,5-7" as sorted counts; raises ScenarioError."""
    counts: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,99})\s*(?:-\s*(\d{1,99})\s*)?", part)
        if not match:
            raise ScenarioError(f"--tractors {text!r} is not a count; write for instance 3, 1-6 or 1,3,5.")
        low, high = int(match[1]), int(match[2] or match[1])
        if low > high:
            raise ScenarioError(f"--tractors {part.strip()!r} runs backwards; write {high}-{low}.")
        if high > MOST_TRACTORS:
            raise ScenarioError(f"{high} tractors cannot be planned; use 1 to {MOST_TRACTORS}.")
        counts.update(range(low, high + 1))
    return tuple(sorted(counts))
