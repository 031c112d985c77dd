"""The strategies by name: those of Headland in the order in which they are offered, and those of other packages.

Each of Headland's has a module named like it with the record STRATEGY; strategies/__init__.py explains how to add one.
Those of other packages (strategies.names) are loaded when they are named. A fault of any is why it has no plan.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import cache, wraps
from importlib import import_module
from importlib.metadata import EntryPoint
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from fields.errors import HeadlandError, StopError, suggest_name
from strategies.names import STRATEGY_NAMES, get_package_name, list_entry_points, list_strategy_names
from strategies.path_planning.errors import StrategyError
from strategies.rules.dealing import DealtLine, LineDeal
from strategies.rules.driving_rules import DrivingRules
from strategies.strategy_record import Strategy
from vehicle.missions.plan import LegGate


def get_strategy(name: str) -> Strategy:
    """The strategy of a name; raises StrategyError for an unknown one, and for one that cannot be loaded."""
    if name in STRATEGIES:
        return STRATEGIES[name]
    found, known = [one for one in list_entry_points() if one.name == name], list_strategy_names()
    if not found:
        raise StrategyError(f"Strategy {name!r} is unknown{suggest_name(name, known)}; use one of: {', '.join(known)}.")
    if len(found) > 1:
        packages = " and ".join(map(get_package_name, found))
        raise StrategyError(f"Strategy {name!r} is in {packages}; uninstall one of them.")
    return _load_strategy(found[0])


def describe_hidden_strategies() -> list[str]:
    """A sentence on every strategy of another package that has a name of Headland's."""
    return [
        f"Strategy {one.name!r} of the package {get_package_name(one)} is left out, as Headland has one of that name; "
        "rename it there."
        for one in list_entry_points()
        if one.name in STRATEGY_NAMES
    ]


def list_source_files(names: Collection[str]) -> list[Path]:
    """The source files of those of the strategies that are of other packages."""
    modules = {one.module.partition(".")[0] for one in list_entry_points() if one.name in names}
    files = list[Path]()
    for spec in filter(None, map(find_spec, sorted(modules))):
        folders = spec.submodule_search_locations  # of a package, with or without a module of its own
        files += [file for folder in folders or () for file in sorted(Path(folder).rglob("*.py"))]
        files += [Path(spec.origin)] if folders is None and spec.origin else []
    return files


@cache
def _load_strategy(entry: EntryPoint) -> Strategy:
    """The record of an entry point, whose functions raise StrategyError alone."""
    label = f"Strategy {entry.name!r} of the package {get_package_name(entry)}"
    try:
        record = entry.load()
        if not isinstance(record, Strategy) or record.name != entry.name:
            raise TypeError(f"{entry.value} is no headland.Strategy of that name")
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise StrategyError(f"{label} cannot be loaded ({reason}); repair or uninstall that package.") from error
    return guard_strategy(record, label)


def guard_strategy(record: Strategy, label: str) -> Strategy:
    """A record whose functions raise StrategyError alone, in place of any fault of theirs."""
    rule = record.formation
    return replace(
        record,
        deal=record.deal and _convert_faults(record.deal, label, _check_deal),
        formation=rule and replace(rule, queue_rule=_convert_faults(rule.queue_rule, label, _check_gates)),
    )


def _convert_faults(function: Callable[..., Any], label: str, check: Callable[..., None]) -> Callable[..., Any]:
    """A function of a strategy, whose faults become a reason why it has no plan; `check` takes output and inputs."""

    @wraps(function)
    def call(*inputs: Any) -> Any:
        try:
            output = function(*inputs)
            check(output, *inputs)
            return output
        except (HeadlandError, StopError):
            raise
        except Exception as error:
            raise StrategyError(f"{label} failed ({type(error).__name__}: {error}).") from error

    return call


def _check_deal(deal: Any, lines: Sequence[DealtLine], rules: DrivingRules, tractors: int) -> None:
    if not isinstance(deal, LineDeal):
        raise TypeError(f"it gives a {type(deal).__name__} in place of a LineDeal")
    if deal.allowed.shape != (tractors, len(lines)):
        raise ValueError(f"allowed has the shape {deal.allowed.shape} in place of {(tractors, len(lines))}")
    if deal.places is not None and len(deal.places) != len(lines):
        raise ValueError(f"places are {len(deal.places)} in place of {len(lines)}, one for each line")


def _check_gates(gates: Any, *_: Any) -> None:
    if not isinstance(gates, list) or not all(isinstance(gate, LegGate) for gate in gates):
        raise TypeError("its queue rule gives something else than gates")


STRATEGIES: dict[str, Strategy] = {
    name: guard_strategy(import_module(f"strategies.{name.replace('-', '_')}").STRATEGY, f"Strategy {name!r}")
    for name in STRATEGY_NAMES
}
