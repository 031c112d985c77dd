"""The hypotheses of a diagnosis: effect x scope x law x instrument, enumerated from the catalogue.

A hypothesis adds to fields of the model: an amount per coordinate times a basis over the steps of the logs. Which
fields and how much a unit adds is taken from the catalogue itself; a scope (one run, the implement, one side, a circle)
or a law (by speed, angle, time, direction) is only another basis.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from fields.arrays import Flags, Floats
from vehicle.identification.diagnosis.drive_data import DriveData
from vehicle.identification.diagnosis.noise import COMMAND_JITTER
from vehicle.identification.logs.thresholds import TURNED_DEG
from vehicle.identification.replay.simulation import CHAINS, FACTORS
from vehicle.model.effect_kinds import CIRCLE, CoordinateBox, EffectKind, EffectParameter
from vehicle.model.effects import (
    CATALOGUE,
    EFFECTS_BY_ID,
    SLOPE_DRIFT,
    Effect,
    compute_effect_fields,
    get_neutral_values,
)
from vehicle.model.tractor import Tractor

CONSTANT, BY_RUN, BY_DIRECTION = "constant", "by_run", "by_direction"
DIRECTIONS = ("to_east", "to_north")
GRIP_DRIFT, DRIFT_BASIS = "grip_drift", "over_minutes"  # an effect of the catalogue that is a law of grip
WIDTH_PER_TYPICAL = 1.5  # a usual fault is two thirds of a standard deviation of the prior
# Nats that speak against it beforehand: an effect of the catalogue, a law of one, and one of many places.
PENALTIES = {"catalogue": 0.0, "law": 4.0, "place": 5.0}
STRAIGHT_RAD = math.radians(0.3)  # wheels straighter than this have no side
PATCH_RADII_M = (8.0, 14.0)
LAW_WORDS = {
    "by_speed": "speed",
    "by_angle": "the size of the wheel angle",
    "by_implement": "the implement",
    "by_side": "the side",
    "over_minutes": "the driving time",
    BY_DIRECTION: "the direction of travel",
    "by_run": "the run",
    "by_place": "the place",
}

# Laws that a tractor file can hold, as terms of its discrepancy model: the hypothesis, and its terms per coordinate.
TERMS_OF_LAWS: Mapping[str, tuple[str, ...]] = {
    "steering_offset@by_speed": ("angle_by_speed",),
    "steering_offset@by_direction": ("angle_to_east", "angle_to_north"),
    "steering_gain@by_speed": ("grip_by_speed",),
    "steering_gain@by_angle": ("grip_by_angle",),
    "steering_gain@by_implement": ("grip_by_implement",),
    "steering_gain@by_direction": ("grip_to_east", "grip_to_north"),
    "push": ("push_to_east", "push_to_north"),
}

# What the base model is known not to know, in every model with a small prior: tyres relax and creep, a wheel sensor is
# a little off, speeds follow a little later, a ramp is steeper. Standard deviations from truths made by other hands.
NUISANCES: Mapping[str, tuple[str, float]] = {
    "speed_lag": ("speed_lag", 0.25),
    "ramp": ("ramp", 3.0),
    "relaxation": ("relaxation", 0.15),
    "crab": ("crab", 0.006),
    "wheel_scale": ("wheel_scale", 0.005),
    "lateness": ("latency", 0.02 * 60.0),
}
MOST_NUISANCE_WIDTHS = 2.5


@dataclass(frozen=True)
class Coordinate:
    """One number of a hypothesis: what a unit of it adds to fields, the width of its prior with its limits, and the key
    in Bases of what it is multiplied with."""

    slopes: tuple[tuple[str, float], ...]
    width: float
    low: float
    high: float
    basis: str = CONSTANT


@dataclass(frozen=True)
class Hypothesis:
    """An effect with a scope or a law, which `basis` names; `penalty` are nats against it beforehand.

    `finest` is the smallest size that may be claimed, in the unit of the first coordinate; `is_nuisance` marks what
    every model has and no diagnosis reports. `starts` are sizes to try first, in widths.
    """

    id: str
    basis: str
    coordinates: tuple[Coordinate, ...]
    penalty: float = 0.0
    finest: float = 0.0
    is_nuisance: bool = False
    starts: tuple[float, ...] = ()
    place: tuple[float, ...] = ()

    @cached_property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    @cached_property
    def chains(self) -> frozenset[str]:
        """Chains of the simulation that it acts on."""
        names = {name for coordinate in self.coordinates for name, _ in coordinate.slopes}
        return frozenset(chain for chain, fields in CHAINS.items() if names & set(fields))

    def make_constant(self) -> Hypothesis:
        """The same effect without a law, with its first coordinate alone."""
        own = replace(self.coordinates[0], basis=CONSTANT)
        return Hypothesis(self.id, CONSTANT, (own,), is_nuisance=self.is_nuisance)

    @property
    def law(self) -> str:
        """The kind of its law without its place: constant, by_run, by_place, by_speed, ..."""
        return self.basis.split(":")[0]

    @property
    def is_catalogued(self) -> bool:
        """Whether it is an effect of the catalogue as a tractor file holds it."""
        return self.id in EFFECTS_BY_ID and self.law in (CONSTANT, "by_place")

    @property
    def terms(self) -> tuple[str, ...]:
        """The terms of a discrepancy model that hold it; none for an effect."""
        return TERMS_OF_LAWS.get(str(self), ())

    @property
    def is_storable(self) -> bool:
        """Whether a tractor file can hold it as an effect or as terms of its discrepancy model."""
        return self.is_catalogued or bool(self.terms)

    def __str__(self) -> str:
        return self.id if self.basis == CONSTANT else f"{self.id}@{self.basis}"


@dataclass(eq=False)
class Bases:
    """What an amount is multiplied with at every step of the path (m,), by key; circles are added as they are tried."""

    data: DriveData
    arrays: dict[str, Floats] = field(default_factory=dict)

    def __post_init__(self) -> None:
        path = self.data.path
        speed, wheel = np.abs(path["speed"]), path["steady"]
        side = np.where(np.abs(wheel) < STRAIGHT_RAD, 0.0, np.sign(wheel))
        moving_right = np.sign(np.gradient(wheel)) > 0.0
        self.arrays |= {
            CONSTANT: np.ones(len(wheel)),
            "by_speed": speed,
            "by_angle": np.abs(wheel),
            "by_implement": path["working"],
            "by_side:left": (side < 0.0).astype(np.float64),
            "by_side:right": (side > 0.0).astype(np.float64),
            "by_side:to_left": (~moving_right).astype(np.float64),
            "by_side:to_right": moving_right.astype(np.float64),
            "over_minutes": path["seconds"] / 60.0,
            "to_east": path["cosine"],
            "to_north": path["sine"],
        }

    def get(self, key: str) -> Floats:
        """The basis of a key; that of a circle or of a run is made on the first call."""
        if key not in self.arrays:
            kind, *numbers = key.split(":")
            if kind == BY_RUN:
                inside = self.data.path_runs == int(numbers[0])
            else:
                inside = self.find_circle(*map(float, numbers))
            self.arrays[key] = inside.astype(np.float64)
        return self.arrays[key]

    @property
    def has_directions(self) -> bool:
        """Whether the tractor drove in several directions. The measured heading says in which: of a tractor that keeps
        to one it varies by its noise alone, and a law of that would explain the noise."""
        mean_length = math.hypot(float(np.mean(self.arrays["to_east"])), float(np.mean(self.arrays["to_north"])))
        return mean_length < math.cos(math.radians(TURNED_DEG))

    def compute_means(self, hypothesis: Hypothesis) -> Floats:
        """Means (k,) over the logs of what the amounts of a hypothesis are multiplied with."""
        return np.array([float(np.mean(self.get(one.basis))) for one in hypothesis.coordinates])

    def find_circle(self, east: float, north: float, radius: float) -> Flags:
        """Steps (m,) inside a circle."""
        path = self.data.path
        return np.asarray((path["east"] - east) ** 2 + (path["north"] - north) ** 2 < radius * radius)


def scale_effect(
    effect: Effect, data: DriveData, tractor: Tractor
) -> tuple[EffectKind, EffectParameter, CoordinateBox]:
    """The kind of an effect for what these logs hold, such as the slope of their ground, its first parameter for the
    size of a tractor, and the bounds of its coordinates."""
    kind = effect.kind.get_kind_for_place(data.dataset.effect_places.get(effect.id, ()))
    size = effect.size.scale_to_wheelbase(tractor.wheelbase_m)
    return kind, size, kind.build_box(size, float(get_neutral_values(effect.id, tractor.steering)[size.name]))


def list_catalogue(data: DriveData, tractor: Tractor) -> list[Hypothesis]:
    """Every effect of the catalogue as a constant, but circles, whose place is searched for."""
    return [build_constant(effect, data, tractor) for effect in CATALOGUE if effect.kind is not CIRCLE]


def build_constant(effect: Effect, data: DriveData, tractor: Tractor) -> Hypothesis:
    """An effect as a constant: its coordinates about neutral, with the fields that they change."""
    kind, size, box = scale_effect(effect, data, tractor)
    coordinates, neutral = [], np.array(box.neutral)
    for place, typical in enumerate(box.typical):
        # What a unit of a coordinate adds to fields of the model, by the formulas of the catalogue.
        moved, step = neutral.copy(), 1e-3 * typical
        moved[place] += step
        if effect.id == SLOPE_DRIFT and len(neutral) == 1:
            share = float(kind.compute_values(effect.params, np.array([typical]))["per_slope"])
            slopes: tuple[tuple[str, float], ...] = (("per_slope", share / typical),)
        elif effect.id == GRIP_DRIFT:
            slopes = (("bend", 1.0),)
        else:
            before, after = (
                compute_effect_fields({effect.id: kind.compute_values(effect.params, numbers, ())})
                for numbers in (neutral, moved)
            )
            changed = [name for name in after if name in before and after[name] != before[name]]
            slopes = tuple((name, (after[name] - before[name]) / step) for name in changed)
        low, high = box.low[place] - box.neutral[place], box.high[place] - box.neutral[place]
        basis = DRIFT_BASIS if effect.id == GRIP_DRIFT else CONSTANT
        coordinates.append(Coordinate(slopes, WIDTH_PER_TYPICAL * typical, low, high, basis))
    starts = tuple(start / coordinates[0].width for start in effect.starts)
    return Hypothesis(effect.id, CONSTANT, tuple(coordinates), 0.0, size.finest, starts=starts)


def build_scope(parent: Hypothesis, law: str, keys: Sequence[str] = (), scale: float = 1.0) -> Hypothesis:
    """An effect that follows a law, a basis whose usual size is `scale`, without limits; of several keys its first."""
    own = parent.coordinates[:1] * len(keys) or parent.coordinates
    coordinates = tuple(
        Coordinate(one.slopes, one.width / scale, -math.inf, math.inf, key)
        for one, key in zip(own, keys or [law] * len(own), strict=True)
    )
    return Hypothesis(parent.id, law, coordinates, PENALTIES["law"], parent.finest / scale)


def list_laws(parent: Hypothesis, bases: Bases) -> list[Hypothesis]:
    """All laws of an effect that these logs can show."""
    runs, laws = bases.data.runs, list[Hypothesis]()
    in_catalogue = {effect.same_law for effect in CATALOGUE}
    if runs > 1 and parent.size == 1:
        laws.append(build_scope(parent, BY_RUN, [f"{BY_RUN}:{run}" for run in range(runs)]))
    if bases.has_directions and parent.size == 1 and ("path" in parent.chains or parent.id == "heading_bias"):
        laws.append(build_scope(parent, BY_DIRECTION, DIRECTIONS))
    for key, values in bases.arrays.items():
        if key == CONSTANT or key.startswith(("by_place", BY_RUN, *DIRECTIONS)):
            continue
        is_varied = float(np.std(values)) > 1e-3 * max(float(np.abs(values).max()), 1e-9)
        # Sides of movement are for the steering system, sides of the wheels for the path; columns do not know either.
        if key.startswith("by_side:to_"):
            is_for_it = "steering" in parent.chains
        elif key.startswith("by_side"):
            is_for_it = parent.chains == frozenset({"path"})
        else:
            is_for_it = "instruments" not in parent.chains or key == "over_minutes"
        if is_varied and is_for_it and f"{parent.id}@{key}" not in in_catalogue:
            scale = float(np.sqrt(np.mean(values * values))) if ":" not in key else 1.0
            laws.append(build_scope(parent, key, scale=max(scale, 1e-6)))
    return laws


def list_competitors(data: DriveData, tractor: Tractor, bases: Bases) -> list[Hypothesis]:
    """What may look like an effect of the catalogue and is none: laws of grip, angle, speed and of single runs."""
    constants = {one.id: one for one in list_catalogue(data, tractor)}
    wide = ("steering_gain", "steering_offset")
    hypotheses = [law for name in wide for law in list_laws(constants[name], bases) if law.law != "by_side"]
    hypotheses += [law for law in list_laws(constants["wheel_slip"], bases)
                   if law.law in ("by_speed", BY_RUN, "over_minutes")]  # fmt: skip
    for name in ("steering_rate", "steering_deadband"):
        hypotheses += [law for law in list_laws(constants[name], bases) if law.law == "by_side"]
    hypotheses += [law for law in list_laws(constants[SLOPE_DRIFT], bases) if law.law == "by_implement"]
    hypotheses += [law for law in list_laws(constants["heading_bias"], bases) if law.law == BY_DIRECTION]
    if float(np.ptp(bases.get("by_implement"))) > 0.0:
        hypotheses.append(build_scope(constants["speed_scale"], "by_implement"))
    clocks = (constants[f"clock_offset_{column}"] for column in ("position", "heading"))
    hypotheses += [build_scope(clock, "over_minutes") for clock in clocks]
    wheel_scale = Coordinate((("wheel_scale", 1.0),), 0.1, -0.8, 2.0)
    hypotheses.append(Hypothesis("wheel_sensor_scale", CONSTANT, (wheel_scale,), PENALTIES["law"], 0.02))
    latency = constants["gnss_latency"]
    own = latency.coordinates[0]
    late = replace(own, slopes=(*own.slopes, ("speed_clock", 1.0)))
    hypotheses.append(replace(latency, basis="with_speed", coordinates=(late,), penalty=PENALTIES["law"]))
    push = tuple(Coordinate(((name, 1.0),), 0.075, -math.inf, math.inf) for name in ("push_east", "push_north"))
    hypotheses.append(Hypothesis("push", CONSTANT, push, PENALTIES["law"], 0.01))
    return hypotheses


def list_nuisances(data: DriveData) -> list[Hypothesis]:
    """The nuisances of every model; commands are late by what the interval between rows leaves open."""
    nuisances = []
    for name, (field_name, width) in NUISANCES.items():
        low = 0.0 if name in ("speed_lag", "ramp", "relaxation") else -MOST_NUISANCE_WIDTHS * width
        coordinate = Coordinate(((field_name, 1.0),), width, low, MOST_NUISANCE_WIDTHS * width)
        nuisances.append(Hypothesis(f"_{name}", CONSTANT, (coordinate,), is_nuisance=True))
    width = COMMAND_JITTER * data.row_step_s
    command = Coordinate((("command_clock", -1.0),), width, -MOST_NUISANCE_WIDTHS * width, MOST_NUISANCE_WIDTHS * width)
    return [*nuisances, Hypothesis("_command", CONSTANT, (command,), is_nuisance=True)]


def sum_fields(
    model: Sequence[Hypothesis], amounts: Floats, bases: Bases, base: Mapping[str, float]
) -> dict[str, Floats]:
    """The fields (m,) of all hypotheses together, for those that differ from the base."""
    fields: dict[str, Floats] = {}
    for hypothesis, own in split_amounts(model, amounts):
        for amount, coordinate in zip(own, hypothesis.coordinates, strict=True):
            if amount == 0.0:
                continue
            values = bases.get(coordinate.basis)
            for name, slope in coordinate.slopes:
                part = slope * amount * values
                if name in FACTORS:
                    fields[name] = fields.get(name, base[name]) * (1.0 + part)
                else:
                    fields[name] = fields.get(name, base[name]) + part
    return fields


def split_amounts(model: Sequence[Hypothesis], amounts: Floats) -> Iterator[tuple[Hypothesis, Floats]]:
    """Every hypothesis with its own amounts."""
    place = 0
    for hypothesis in model:
        yield hypothesis, amounts[place : place + hypothesis.size]
        place += hypothesis.size


def collect_widths(model: Sequence[Hypothesis]) -> Floats:
    """Widths of all coordinates of a model."""
    return np.array([one.width for hypothesis in model for one in hypothesis.coordinates])
