"""The strategies by name, in the order in which they are offered.

Each has a module named like it with the record STRATEGY; strategies/__init__.py explains how to add one.
"""

from __future__ import annotations

from importlib import import_module

from strategies.names import STRATEGY_NAMES
from strategies.program.strategy_record import Strategy

STRATEGIES: dict[str, Strategy] = {
    name: import_module(f"strategies.{name.replace('-', '_')}").STRATEGY for name in STRATEGY_NAMES
}
