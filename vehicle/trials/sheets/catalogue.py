"""Runs experiments and design studies by name."""

from __future__ import annotations

from collections.abc import Callable

from fields.errors import suggest_name
from vehicle.errors import VehicleError
from vehicle.model.tractor import Tractor, load_tractor
from vehicle.trials.sheets.sheet import ExperimentSheet

EXPERIMENTS = ("circles", "step", "zigzag", "navigation", "fixed", "changing", "slip", "twin")
STUDIES = ("tyres", "mass")


def check_name(name: str, names: tuple[str, ...], kind: str) -> None:
    """Raise VehicleError for an unknown experiment or study, naming the known ones."""
    if name not in names:
        raise VehicleError(
            f"The {kind} {name!r} is unknown{suggest_name(name, names)}; use one of: {', '.join(names)}."
        )


def run_experiments(
    names: tuple[str, ...] = EXPERIMENTS, *, seed: int = 1, progress: Callable[[int, int], None] | None = None
) -> tuple[ExperimentSheet, ...]:
    """Run experiments with the thesis's tractor, in the order given. Raises VehicleError for an unknown name."""
    from vehicle.trials.sheets.fixed_steering import build_changing_sheet, build_circles_sheet, build_fixed_sheet
    from vehicle.trials.sheets.path_following import (
        build_navigation_sheet,
        build_slip_sheet,
        build_step_sheet,
        build_zigzag_sheet,
    )
    from vehicle.trials.sheets.twin_link import build_twin_sheet

    tractor = load_tractor("eg105")
    runs: dict[str, Callable[[Tractor], ExperimentSheet]] = {
        "circles": build_circles_sheet,
        "step": lambda machine: build_step_sheet(machine, seed),
        "zigzag": build_zigzag_sheet,
        "navigation": lambda machine: build_navigation_sheet(machine, seed),
        "fixed": build_fixed_sheet,
        "changing": build_changing_sheet,
        "slip": build_slip_sheet,
        "twin": lambda machine: build_twin_sheet(machine, seed),
    }
    sheets = []
    for number, name in enumerate(names):
        check_name(name, EXPERIMENTS, "experiment")
        sheets.append(runs[name](tractor))
        if progress:
            progress(number + 1, len(names))
    return tuple(sheets)


def run_design_study(study: str, tractor: str = "eg105") -> ExperimentSheet:
    """Run a design study for a tractor; raises VehicleError for an unknown study."""
    from vehicle.trials.sheets.fixed_steering import build_mass_sheet, build_tyres_sheet

    check_name(study, STUDIES, "study")
    machine = load_tractor(tractor)
    return build_tyres_sheet(machine) if study == "tyres" else build_mass_sheet(machine)
