"""The strategies by name, in the order they are offered in.

Each has a module of its own, named like it, with the record STRATEGY; strategies/__init__.py says how to add one.
"""

from __future__ import annotations

from importlib import import_module

from strategies.names import NAMES
from strategies.record import Strategy

STRATEGIES: dict[str, Strategy] = {
    name: import_module(f"strategies.{name.replace('-', '_')}").STRATEGY for name in NAMES
}
