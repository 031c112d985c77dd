"""Refusals of this room, and how all refusals end.

    fields.errors.FieldError           the field cannot be read or worked
    vehicle.errors.VehicleError        a tractor, implement or ground that cannot be
        vehicle.errors.MissionError    a plan that no world can execute
    strategies.errors.StrategyError    a strategy that cannot work this field with this fleet
    planner.errors.ScenarioError       a scenario that asks for the impossible

All are ValueErrors with one sentence. The command line prints it and exits with status 2; anything else is a fault
of Headland and exits with status 1.
"""

from __future__ import annotations

from fields.errors import FieldError
from strategies.errors import StrategyError
from vehicle.errors import VehicleError


class ScenarioError(ValueError):
    """An option or a combination of options that cannot be planned: value, rule and fix in one sentence."""


REFUSALS = (FieldError, VehicleError, StrategyError, ScenarioError)
