"""What the steps of a tractor are called: ``track 14, northwards``, ``U over 2 tracks to track 16``."""

from __future__ import annotations

from reports.results import Step
from reports.wording import listed

_POINTS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
_MOST_NAMED = 4  # of more tractors that are waited for, only how many they are
_TURNS = {"u": "U", "omega": "omega", "switch-back": "switch-back"}


def step_words(step: Step) -> str:
    """A step in a few words."""
    if step.kind == "wait":
        return f"wait{_for(step.for_tractors)}"
    if step.kind == "refill":
        amount = "" if step.amount is None else f" {abs(step.amount):.0f} l or kg"
        return f"{'unload' if (step.amount or 0.0) < 0.0 else 'refill'}{amount}"
    if step.kind == "refill-way":
        return "way to where it refills"
    if step.kind == "drive":
        return "drive on"
    if step.kind == "leave":
        return "on to the entrance" if step.again else "back to the entrance"
    if step.kind == "enter" and step.number is None:
        return "in by the entrance"
    goal = goal_words(step)
    if step.kind in ("track", "round"):
        return f"{goal}, {'the rest' if step.again else heading_words(step.bearing_deg)}"
    if step.again:
        return f"on to {goal}"
    if step.kind == "corner":
        return f"corner to side {step.part}{', backing up' if step.shape == 'switch-back' else ''}"
    if step.kind == "enter":
        return f"from the entrance to {goal}"
    if step.kind == "way":
        return f"way to {goal}"
    over = "" if step.over is None else f" over {step.over} track{'s' if step.over > 1 else ''}"
    return f"{_TURNS.get(step.shape, 'turn')}{over} to {goal}"


def goal_words(step: Step) -> str:
    """What is worked or led to: ``track 14a``, ``round 2, side 3``."""
    if not step.to_round:
        return f"track {step.number}{step.part}"
    return f"round {step.number}" + (f", side {step.part}" if step.part else "")


def heading_words(bearing_deg: float | None) -> str:
    """A direction clockwise from north as ``north-eastwards``; ``all round`` for one that leads back."""
    if bearing_deg is None:
        return "all round"
    return f"{_POINTS[round(bearing_deg / 45.0) % 8]}wards"


def _for(tractors: tuple[int, ...]) -> str:
    if not tractors:
        return ""
    if len(tractors) > _MOST_NAMED:
        return f" for {len(tractors)} tractors"
    return f" for tractor{'s' if len(tractors) > 1 else ''} {listed(tractors)}"
