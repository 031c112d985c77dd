"""A whole farm file: read, checked, and its machines by name."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError, field_validator, model_validator

from fields.reading import brief, parse_fault, read_text, shown
from planner.errors import ScenarioError, nearest
from planner.farm.chances import Chances
from planner.farm.learned import LearnedValue
from planner.farm.machines import FarmImplement, FarmTractor
from planner.farm.prices import Prices
from planner.farm.times import Times, Yard
from planner.farm.values import Section
from vehicle.errors import VehicleError
from vehicle.faults import faults_of
from vehicle.tractor import tractor_names

Machine = TypeVar("Machine", FarmTractor, FarmImplement)
MOST_TOLD = 30
USUAL = (FarmTractor(name="Yanmar EG105", file="eg105"),)
USUAL_IMPLEMENT = (FarmImplement(name="cultivator", width_m=3.0),)


class FarmFile(Section):
    """What a farm has and pays. Every value may be left out; its default has a source (planner.farm.sources).

    Without tractors there is one of the thesis, without implements its cultivator of 3 m.
    """

    tractors: tuple[FarmTractor, ...] = USUAL
    implements: tuple[FarmImplement, ...] = USUAL_IMPLEMENT
    prices: Prices = Prices()
    times: Times = Times()
    chances: Chances = Chances()
    yard: Yard = Yard()
    learned: tuple[LearnedValue, ...] = ()

    @field_validator("tractors", "implements", "learned", mode="before")
    @classmethod
    def _are_listed(cls, given: Any) -> Any:
        if isinstance(given, Mapping):
            raise ValueError("write the heading of each machine with two brackets on either side, as [[tractors]]")
        return given

    @model_validator(mode="after")
    def _fits_together(self) -> FarmFile:
        faults = list(_faults(self))
        if faults:
            raise ValueError("; ".join(faults))
        return self

    def tractor(self, name: str | None = None) -> FarmTractor:
        """A kind of tractor by name, the first without one; raises ScenarioError."""
        return _pick(self.tractors, name, "tractor")

    def implement(self, name: str | None = None) -> FarmImplement:
        """An implement by name, the first without one; raises ScenarioError."""
        return _pick(self.implements, name, "implement")

    def fits(self, tractor: FarmTractor, implement: FarmImplement) -> bool:
        """Whether an implement goes with a kind of tractor."""
        return not implement.tractors or tractor.name in implement.tractors


def load_farm(where: str | Path) -> FarmFile:
    """Read a farm file; files of tractors are looked for beside it.

    Raises ScenarioError with every fault of the file in one sentence, VehicleError for a tractor's file.
    """
    return farm_from(read_text(where, "a farm file (TOML)", ScenarioError), str(where), Path(where).parent)


def farm_from(text: str, called: str, folder: Path = Path()) -> FarmFile:
    """The farm of a text; `called` names it in refusals."""
    values: dict[str, Any] = {}
    try:
        values = tomllib.loads(text)
        farm = FarmFile.model_validate(values)
    except ValidationError as error:
        faults = _with_names(faults_of(error, FarmFile, MOST_TOLD), values)
        raise ScenarioError(f"The farm file {called} cannot be used: {faults}.", parameter="farm") from None
    except (ValueError, RecursionError) as error:
        raise ScenarioError(f"The farm file {called} is not TOML: {parse_fault(error)}.", parameter="farm") from None
    if "tractors" not in farm.model_fields_set:
        return farm
    return farm.model_copy(update={"tractors": tuple(_with_file(each, called, folder) for each in farm.tractors)})


def _with_names(faults: str, values: Mapping[str, Any]) -> str:
    """Faults with machines called by their names, where they have any, instead of their numbers."""

    def called(match: re.Match[str]) -> str:
        kind, number = match[1], int(match[2])
        name = values[kind][number].get("name")
        return f"{kind}.{name}" if isinstance(name, str) and name else f"{kind} no. {number + 1}"

    return re.sub(r"\b(tractors|implements)\.(\d+)(?=\.)", called, faults)


def _with_file(tractor: FarmTractor, called: str, folder: Path) -> FarmTractor:
    """The tractor with its file as seen from here; read once, so that a fault of it shows at once."""
    if tractor.file is not None and tractor.file not in tractor_names():
        tractor = tractor.model_copy(update={"file": str(folder / tractor.file)})
    try:
        tractor.machine()
    except VehicleError as error:
        raise VehicleError(f"The tractor {tractor.name!r} of the farm file {called}: {error}") from None
    return tractor


def example_text() -> str:
    """The farm file that comes with Headland, as text."""
    return (resources.files("planner.farm") / "example.toml").read_text(encoding="utf-8")


def example_farm() -> FarmFile:
    """The farm that comes with Headland."""
    return farm_from(example_text(), "example.toml")


def _pick(machines: Sequence[Machine], name: str | None, kind: str) -> Machine:
    if name is None:
        return machines[0]
    for each in machines:
        if each.name == name:
            return each
    names = [each.name for each in machines]
    raise ScenarioError(
        f"The farm has no {kind} {shown(name)}{nearest(name, names)}; use one of: {', '.join(names)}.", parameter=kind
    )


def _faults(farm: FarmFile) -> Iterator[str]:
    """What does not go together."""
    for kind, machines in (("tractors", farm.tractors), ("implements", farm.implements)):
        names = [each.name for each in machines]
        if not names:
            yield f"{kind} is empty; name one or more, or leave {kind} out"
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            yield f"{kind} has {brief(twice[0])} twice; give each its own name"
    known = [each.name for each in farm.tractors]
    for implement in farm.implements:
        yield from _implement_faults(implement, known)
    if farm.tractors and farm.implements:
        for tractor in farm.tractors:
            if not any(farm.fits(tractor, implement) for implement in farm.implements):
                yield f"no implement fits the tractor {tractor.name!r}; name it under tractors of one of them"


def _implement_faults(implement: FarmImplement, known: Sequence[str]) -> Iterator[str]:
    who = f"the implement {implement.name!r}"
    for name in implement.tractors:
        if name not in known:
            yield f"{who} fits {name!r}, which is no tractor of the farm{nearest(name, known)}"
    if (implement.capacity is None) != (implement.rate_per_m2 is None):
        has, lacks = ("capacity", "rate_per_m2") if implement.rate_per_m2 is None else ("rate_per_m2", "capacity")
        unit = "l or kg per m2, usually 0.0001 to 5" if lacks == "rate_per_m2" else "l or kg, usually 200 to 25000"
        yield f"{who} has {has} but no {lacks} ({unit}); give both or neither"
    if implement.frame_width_m is not None and implement.frame_width_m > 2.0 * implement.width_m:
        yield f"{who} has a frame of {implement.frame_width_m:g} m, more than twice its width; check frame_width_m"
