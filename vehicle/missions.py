"""What a tractor can be told to do: legs to drive one after another, and gates that hold it back.

A plan is data. The world executes any plan, so a strategy only writes another one, and a plan can be saved,
drawn and compared.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.errors import MissionError
from vehicle.ground import ground_names

KINDS = ("work", "turn", "drive")
JOINT_M = 0.1  # ends of consecutive legs may differ by this much
Points = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Gate:
    """Start the leg only when tractor `tractor` has driven `after_m` metres of its leg `leg`."""

    tractor: int
    leg: int
    after_m: float = 0.0


@dataclass(frozen=True)
class Follow:
    """While tractor `tractor` is on its leg `leg`, keep `gap_m` behind it (Eq. 6.1)."""

    tractor: int
    leg: int
    gap_m: float = 10.0


@dataclass(frozen=True, eq=False)
class Leg:
    """A polyline (n, 2) in metres to be driven in one gear at one target speed.

    `gear` is 1 or -1; `implement` tells whether it works; `kind` is what the time counts as.
    """

    points: Points
    speed_mps: float
    gear: int = 1
    implement: bool = False
    ground: str = "soil"
    kind: str = "drive"
    gates: tuple[Gate, ...] = ()
    follow: Follow | None = None

    @property
    def length_m(self) -> float:
        """Length of the polyline."""
        return float(np.hypot(*np.diff(self.points, axis=0).T).sum())

    def with_gates(self, gates: Iterable[Gate]) -> Leg:
        """The same leg with further gates."""
        return replace(self, gates=self.gates + tuple(gates))


@dataclass(frozen=True)
class Mission:
    """The legs of one tractor, in order. It starts at the first point, facing along the first segment."""

    legs: tuple[Leg, ...]

    @property
    def start(self) -> tuple[float, float, float]:
        """x, y and heading (mathematical angle) at the start."""
        first = self.legs[0]
        (x, y), (x1, y1) = first.points[0], first.points[1]
        heading = math.atan2(first.gear * (y1 - y), first.gear * (x1 - x))
        return float(x), float(y), heading


@dataclass(frozen=True)
class Plan:
    """One mission per tractor, and notes that say where the plan comes from."""

    missions: tuple[Mission, ...]
    notes: dict[str, Any] = field(default_factory=dict)

    @property
    def tractors(self) -> int:
        """Number of tractors."""
        return len(self.missions)

    def with_gate(self, tractor: int, leg: int, gate: Gate) -> Plan:
        """The same plan with one more gate."""
        legs = list(self.missions[tractor].legs)
        legs[leg] = legs[leg].with_gates([gate])
        missions = list(self.missions)
        missions[tractor] = Mission(tuple(legs))
        return replace(self, missions=tuple(missions))


def check_plan(plan: Plan) -> None:
    """Raise MissionError at the first leg or gate that no world can execute."""
    if not plan.missions:
        raise MissionError("A plan needs at least one tractor; it has none.")
    for number, mission in enumerate(plan.missions):
        if not mission.legs:
            raise MissionError(f"Tractor {number} has no legs; give it at least one or leave it out.")
        for index, leg in enumerate(mission.legs):
            where = f"Tractor {number}, leg {index}"
            _check_leg(leg, where)
            _check_links(plan, number, leg, where)
            if index:
                _check_joint(mission.legs[index - 1], leg, where)


def _check_leg(leg: Leg, where: str) -> None:
    points = leg.points
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
        raise MissionError(f"{where}: points have shape {points.shape}; a leg needs two or more (x, y) points.")
    if not np.isfinite(points).all():
        raise MissionError(f"{where}: a coordinate is not a number; every point needs finite metres.")
    if leg.length_m < 1e-3:
        raise MissionError(f"{where}: the leg is {leg.length_m:.4f} m long; it must be at least 1 mm.")
    if np.hypot(*(points[1] - points[0])) < 1e-6:
        raise MissionError(f"{where}: the first two points coincide, which gives no direction; leave one out.")
    if leg.gear not in (1, -1):
        raise MissionError(f"{where}: gear {leg.gear} is unknown; use 1 (forward) or -1 (reverse).")
    if not (leg.speed_mps > 0 and math.isfinite(leg.speed_mps)):
        raise MissionError(f"{where}: speed {leg.speed_mps} m/s is not above 0; gear -1 drives backwards.")
    if leg.ground not in ground_names():
        raise MissionError(f"{where}: ground {leg.ground!r} is unknown; use one of: {', '.join(ground_names())}.")
    if leg.follow and not (leg.follow.gap_m > 0 and math.isfinite(leg.follow.gap_m)):
        raise MissionError(f"{where}: a follow gap of {leg.follow.gap_m} m is not a distance; use one above 0.")
    if leg.kind not in KINDS:
        raise MissionError(f"{where}: kind {leg.kind!r} is unknown; use one of: {', '.join(KINDS)}.")


def _check_joint(before: Leg, after: Leg, where: str) -> None:
    gap = float(np.hypot(*(after.points[0] - before.points[-1])))
    if gap > JOINT_M:
        raise MissionError(
            f"{where}: starts {gap:.2f} m from where the leg before ends; they must meet within {JOINT_M} m."
        )


def _check_links(plan: Plan, tractor: int, leg: Leg, where: str) -> None:
    links: list[Gate | Follow] = [*leg.gates, *([leg.follow] if leg.follow else [])]
    for link in links:
        if not 0 <= link.tractor < plan.tractors or link.tractor == tractor:
            raise MissionError(f"{where}: refers to tractor {link.tractor}; name another tractor of this plan.")
        if not 0 <= link.leg < len(plan.missions[link.tractor].legs):
            raise MissionError(f"{where}: refers to leg {link.leg} of tractor {link.tractor}, which has no such leg.")
    for gate in leg.gates:
        length = plan.missions[gate.tractor].legs[gate.leg].length_m
        if not -1e-9 <= gate.after_m <= length + JOINT_M:
            raise MissionError(
                f"{where}: waits for {gate.after_m} m of leg {gate.leg} of tractor {gate.tractor}, "
                f"which is {length:.2f} m long; use a distance on that leg."
            )


def plan_to_json(plan: Plan) -> str:
    """The plan as JSON text, which `headland plan --save` writes; `plan_from_json` gives it back exactly."""
    return json.dumps(
        {
            "notes": plan.notes,
            "tractors": [[_leg_to_dict(leg) for leg in mission.legs] for mission in plan.missions],
        },
        indent=1,
    )


def _leg_to_dict(leg: Leg) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "kind": leg.kind,
        "gear": leg.gear,
        "speed_mps": leg.speed_mps,
        "implement": leg.implement,
        "ground": leg.ground,
        "points_m": leg.points.tolist(),
        "gates": [{"tractor": g.tractor, "leg": g.leg, "after_m": g.after_m} for g in leg.gates],
    }
    if leg.follow:
        entry["follow"] = {"tractor": leg.follow.tractor, "leg": leg.follow.leg, "gap_m": leg.follow.gap_m}
    return entry


def plan_from_json(text: str) -> Plan:
    """Read a plan; raises MissionError when it is not one or cannot be executed."""
    try:
        data = json.loads(text)
        missions = tuple(Mission(tuple(_leg_from_dict(leg) for leg in legs)) for legs in data["tractors"])
        plan = Plan(missions, dict(data.get("notes", {})))
    except json.JSONDecodeError as error:
        raise MissionError(f"The plan is not JSON: {error}.") from None
    except MissionError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise MissionError(f"The plan lacks or garbles an entry: {error!r}.") from None
    check_plan(plan)
    return plan


def _leg_from_dict(entry: dict[str, Any]) -> Leg:
    follow = entry.get("follow")
    return Leg(
        points=np.array(entry["points_m"], dtype=np.float64),
        speed_mps=float(entry["speed_mps"]),
        gear=_exactly(entry, "gear", int),
        implement=_exactly(entry, "implement", bool),
        ground=str(entry["ground"]),
        kind=str(entry["kind"]),
        gates=tuple(Gate(int(g["tractor"]), int(g["leg"]), float(g["after_m"])) for g in entry["gates"]),
        follow=Follow(int(follow["tractor"]), int(follow["leg"]), float(follow["gap_m"])) if follow else None,
    )


def _exactly(entry: dict[str, Any], key: str, kind: type) -> Any:
    value = entry[key]
    if type(value) is not kind:
        raise TypeError(f"{key} is {value!r}, not of type {kind.__name__}")
    return value
