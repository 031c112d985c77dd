"""The farm file: read, checked, and its machines by name."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import model_validator

from fields.text_files import quote_path, read_text
from planner.errors import RequestError, shorten_value, suggest_name
from planner.farm.machines import FarmImplement, FarmTractor
from planner.farm.random_inputs import UncertaintySettings
from planner.farm.settings import (
    FarmPrices,
    FarmTimes,
    FileSection,
    LearnedValue,
    Yard,
    read_example_text,
)
from planner.farm.workday import Workday
from vehicle.errors import VehicleError
from vehicle.model.tractor import list_tractor_names
from vehicle.model.validation_messages import parse_settings

Machine = TypeVar("Machine", FarmTractor, FarmImplement)
OLD_UNCERTAINTY_SECTION = "chances"
DEFAULT_TRACTORS = (FarmTractor(name="Yanmar EG105", file="eg105"),)
DEFAULT_IMPLEMENTS = (FarmImplement(name="cultivator", width_m=3.0),)


class FarmFile(FileSection, title="farm file"):
    """What a farm owns and pays. All values are optional; defaults have sources (planner.farm.value_sources).

    The default machines are one tractor of the thesis and its 3 m cultivator.
    """

    tractors: tuple[FarmTractor, ...] = DEFAULT_TRACTORS
    implements: tuple[FarmImplement, ...] = DEFAULT_IMPLEMENTS
    prices: FarmPrices = FarmPrices()
    times: FarmTimes = FarmTimes()
    uncertainty: UncertaintySettings = UncertaintySettings()
    yard: Yard = Yard()
    learned: tuple[LearnedValue, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _check_sections(cls, values: Any) -> Any:
        if OLD_UNCERTAINTY_SECTION in values:
            raise ValueError(
                f"the section [{OLD_UNCERTAINTY_SECTION}] is now [uncertainty]; rename it, also in the keys of "
                "[[learned]]"
            )
        return values

    @model_validator(mode="after")
    def _check_machines(self) -> FarmFile:
        """Raise ValueError for contradictions between machines, and for duplicate names."""
        faults = []
        for kind, machines in (("tractors", self.tractors), ("implements", self.implements)):
            names = [each.name for each in machines]
            if not names:
                faults.append(f"{kind} is empty; name one or more, or leave {kind} out")
            duplicates = sorted({name for name in names if names.count(name) > 1})
            if duplicates:
                faults.append(f"{kind} has {shorten_value(duplicates[0])} twice; give each a unique name")
        known = [each.name for each in self.tractors]
        for implement in self.implements:
            label = f"the implement {implement.name!r}"
            for name in implement.tractors:
                if name not in known:
                    close = suggest_name(name, known)
                    faults.append(f"{label} names {name!r}, which is not a tractor of the farm{close}")
            if (implement.capacity is None) != (implement.rate_per_m2 is None):
                lacks_rate = implement.rate_per_m2 is None
                given, missing = ("capacity", "rate_per_m2") if lacks_rate else ("rate_per_m2", "capacity")
                unit = "l or kg per m2, usually 0.0001 to 5" if lacks_rate else "l or kg, usually 200 to 25000"
                faults.append(f"{label} has {given} but no {missing} ({unit}); give both or neither")
            frame_m = implement.frame_width_m
            if frame_m is not None and frame_m > 2.0 * implement.width_m:
                faults.append(f"{label} has a frame of {frame_m:g} m, more than twice its width; check frame_width_m")
        for tractor in self.tractors if self.implements else ():
            if not any(self.is_compatible(tractor, implement) for implement in self.implements):
                faults.append(f"no implement fits the tractor {tractor.name!r}; name it under tractors of one of them")
        if faults:
            raise ValueError("; ".join(faults))
        return self

    def get_tractor(self, name: str | None = None) -> FarmTractor:
        """A kind of tractor by name, the first one without a name; raises RequestError."""
        return _pick_machine(self.tractors, name, "tractor")

    def get_implement(self, name: str | None = None) -> FarmImplement:
        """An implement by name, the first one without a name; raises RequestError."""
        return _pick_machine(self.implements, name, "implement")

    def is_compatible(self, tractor: FarmTractor, implement: FarmImplement) -> bool:
        """Whether an implement fits a kind of tractor."""
        return not implement.tractors or tractor.name in implement.tractors


def load_farm(path: str | Path) -> FarmFile:
    """Read a farm file; files of tractors are relative to its folder.

    Raises RequestError with all faults of the file in one sentence, VehicleError for the file of a tractor.
    """
    return parse_farm(read_text(path, "a farm file (TOML)", RequestError), str(path), Path(path).parent)


def parse_farm(text: str, label: str, folder: Path = Path()) -> FarmFile:
    """The farm of a text; `label` is its name in messages."""
    farm = parse_settings(text, FarmFile, label, RequestError, "farm")
    start_s = farm.times.shift_span_s[0]
    Workday(start_s or 0, breaks_s=farm.times.break_spans_s, shift_s=farm.times.shift_span_s)  # refuses idle ones
    if "tractors" not in farm.model_fields_set:
        return farm
    tractors = []
    for tractor in farm.tractors:  # files are relative to the folder; built once, so that their faults are found now
        if tractor.file is not None and tractor.file not in list_tractor_names():
            tractor = tractor.model_copy(update={"file": str(folder / tractor.file)})
        try:
            tractor.build_tractor()
        except VehicleError as error:
            raise VehicleError(f"The tractor {tractor.name!r} of the farm file {label}: {error}") from None
        tractors.append(tractor)
    return farm.model_copy(update={"tractors": tuple(tractors)})


def load_example_farm() -> FarmFile:
    """The farm that comes with Headland."""
    return parse_farm(read_example_text("farm"), "example.toml")


def _pick_machine(machines: Sequence[Machine], name: str | None, kind: str) -> Machine:
    if name is None:
        return machines[0]
    for machine in machines:
        if machine.name == name:
            return machine
    names = [machine.name for machine in machines]
    raise RequestError(
        f"The farm has no {kind} {quote_path(name)}{suggest_name(name, names)}; use one of: {', '.join(names)}.",
        parameter=kind,
    )
