"""The farm file: what a farm has and pays, in one TOML file that serves every command.

    from planner.farm import FarmFile, load_farm, example_farm

values      numbers with limits, defaults and where the defaults are from
machines    tractors and implements
prices      money: what machines, fuel, people and late ground cost
times       handling, shifts and breaks; where the yard is
chances     what is left to chance
learned     what the farm's own logs taught
file        FarmFile, all of it: read, checked, machines picked by name
sources     every value in use with its origin: given, or the default's source
"""

from planner.farm.chances import Chances
from planner.farm.file import FarmFile, example_farm, example_text, load_farm
from planner.farm.machines import FarmImplement, FarmTractor
from planner.farm.prices import Prices
from planner.farm.times import Times, Yard

__all__ = [
    "Chances",
    "FarmFile",
    "FarmImplement",
    "FarmTractor",
    "Prices",
    "Times",
    "Yard",
    "example_farm",
    "example_text",
    "load_farm",
]
