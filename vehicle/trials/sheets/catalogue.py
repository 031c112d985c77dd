"""The experiments by name."""

from __future__ import annotations

from collections.abc import Callable

from fields.errors import nearest
from vehicle.errors import VehicleError
from vehicle.tractor import Tractor, load_tractor
from vehicle.trials.sheets.sheet import Sheet

EXPERIMENTS = ("circles", "step", "zigzag", "navigation", "fixed", "changing", "slip", "twin")
STUDIES = ("tyres", "mass")


def check_name(name: str, known: tuple[str, ...], what: str) -> None:
    """Raise VehicleError for an unknown experiment or study, naming the known ones."""
    if name not in known:
        raise VehicleError(f"The {what} {name!r} is unknown{nearest(name, known)}; use one of: {', '.join(known)}.")


def validate(
    names: tuple[str, ...] = EXPERIMENTS, *, seed: int = 1, progress: Callable[[int, int], None] | None = None
) -> tuple[Sheet, ...]:
    """Run experiments with the thesis's tractor, in the order given."""
    from vehicle.trials.sheets.circles import changing, circles, fixed
    from vehicle.trials.sheets.paths import navigation_sheet, slip, zigzag_sheet
    from vehicle.trials.sheets.step import step
    from vehicle.trials.sheets.twin import twin_sheet

    tractor = load_tractor("eg105")
    runs: dict[str, Callable[[Tractor], Sheet]] = {
        "circles": circles,
        "step": lambda machine: step(machine, seed),
        "zigzag": zigzag_sheet,
        "navigation": lambda machine: navigation_sheet(machine, seed),
        "fixed": fixed,
        "changing": changing,
        "slip": slip,
        "twin": lambda machine: twin_sheet(machine, seed),
    }
    sheets = []
    for number, name in enumerate(names):
        check_name(name, EXPERIMENTS, "experiment")
        sheets.append(runs[name](tractor))
        if progress:
            progress(number + 1, len(names))
    return tuple(sheets)


def design(study: str, tractor: str = "eg105") -> Sheet:
    """Run a design study for a tractor; raises VehicleError for an unknown study."""
    from vehicle.trials.sheets.design import mass, tyres

    check_name(study, STUDIES, "study")
    machine = load_tractor(tractor)
    return tyres(machine) if study == "tyres" else mass(machine)
