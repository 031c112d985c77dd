"""What a sweep varies: the options of a plan, each with the values to try, as text or as Python values."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from math import prod
from typing import Any

from fields.geometry.arithmetic import ROUNDING
from planner.errors import RequestError, mark_parameter, shorten_value
from planner.request.option_texts import convert_time_to_text, suggest_number, write_clock
from planner.request.options import PlanOption, list_options
from planner.request.plan_request import WORK, PlanRequest
from strategies.path_planning.turn_kinds import HEADLAND_ORDERS

MOST_POINTS = 100_000
MOST_VALUES = 1000
_RANGE = re.compile(r"(?P<first>[^:]+):(?P<last>[^:]+)(?::(?P<step>[^:]+))?")
CLOCKS = ("start_s", "deadline_s")
_TEXTS = ("tractors", *CLOCKS, "tractor", "soil", "draft")
"""Parameters that are swept though they are neither numbers nor choices."""
_UNSWEPT = ("samples", "seed", "budget", "part", "objective")
"""Parameters that change no estimate, or what is chosen and not what is planned."""
HEADLAND_ORDER = PlanOption(
    "When the headland is worked: first, last.",
    WORK,
    "headland_order",
    choices=HEADLAND_ORDERS,
    parameter="headland_order",
)


@dataclass(frozen=True)
class Axis:
    """An option and the values that a sweep gives it.

    Attributes:
        option: as the command line has it.
        values: of its parameter in a request: SI units, seconds of the day, a tuple with one number of tractors.
        written: the same as the option is written: km/h, hh:mm, one number of tractors.
    """

    option: PlanOption
    values: tuple[Any, ...]
    written: tuple[Any, ...]

    @property
    def parameter(self) -> str:
        """What it sets in a request."""
        return self.option.parameter


def list_swept_options() -> tuple[PlanOption, ...]:
    """The options that a sweep can vary: numbers, choices, clock times, tractors and machines."""
    found = [
        option
        for option in list_options(PlanRequest)
        if option.value is None
        and option.parameter not in _UNSWEPT
        and (option.type in (int, float) or option.choices or option.parameter in _TEXTS)
    ]
    return (*found, HEADLAND_ORDER)


def read_axes(values: Mapping[str, Any]) -> tuple[Axis, ...]:
    """The axes of options, each a text (`3,4.5,6`, `6:12:1`, `1-8`), a value or several of them.

    They go by the name of the option or of its parameter, whose unit they have then (speed_kmh or speed_mps); those
    without a value are none. Raises RequestError.
    """
    swept = list_swept_options()
    options = {option.parameter: option for option in swept} | {option.name: option for option in swept}
    unknown = next((name for name in values if name not in options), None)
    if unknown is not None:
        names = ", ".join(option.name for option in swept)
        raise RequestError(f"A sweep cannot vary {unknown!r}; it varies {names}.")
    given = [(name, options[name], value) for name, value in values.items() if value is not None]
    found = [option.name for _, option, _ in given]
    twice = next((name for name in found if found.count(name) > 1), None)
    if twice is not None:
        raise RequestError(f"The {twice.replace('_', ' ')} is given twice, with its unit and without; give it once.")
    return tuple(_read_axis(*one) for one in given)


def list_points(axes: Sequence[Axis]) -> Iterator[tuple[int, ...]]:
    """The number of the value on every axis, for all combinations; raises RequestError for too many."""
    count = prod(len(axis.values) for axis in axes)
    if count > MOST_POINTS:
        raise RequestError(f"{count:,} combinations are more than a sweep takes; give {MOST_POINTS:,} at most.")
    return product(*(range(len(axis.values)) for axis in axes))


def _read_axis(name: str, option: PlanOption, given: Any) -> Axis:
    parts = _split_text(option, given) if isinstance(given, str) else _list_values(name, option, given)
    written = tuple(dict.fromkeys(parts))
    if not written:
        raise RequestError(f"{mark_parameter(option.parameter)} has no value; give one or more.")
    unknown = next((value for value in written if option.choices and value not in option.choices), None)
    if unknown is not None:
        raise RequestError(
            f"{shorten_value(str(unknown))} is no {option.name.replace('_', ' ')}; use {', '.join(option.choices)}.",
            parameter=option.parameter,
        )
    if len(written) > MOST_VALUES:
        raise RequestError(f"{mark_parameter(option.parameter)} has {len(written)} values; give {MOST_VALUES} at most.")
    if option.parameter == "tractors":
        return Axis(option, tuple((count,) for count in written), written)
    scale = 1.0 if option.limits is None else option.limits.scale
    if name != option.name and scale != 1.0:
        return Axis(option, written, tuple(round(value / scale, 9) for value in written))
    read: Callable[[Any], Any] = option.parse or (lambda value: value)
    return Axis(option, tuple(map(read, written)), written)


def _list_values(name: str, option: PlanOption, given: Any) -> list[Any]:
    """Values that Python gives, of numpy too; texts among them are read as on the command line.

    Numbers by the name of a clock's parameter are seconds of the day.
    """
    several = given if isinstance(given, Iterable) else [given]
    ordered = sorted(several, key=str) if isinstance(several, set | frozenset) else several
    values = [convert_time_to_text(one.item() if hasattr(one, "item") else one) for one in ordered]
    if option.parameter in CLOCKS:
        convert: Callable[[Any], str] = str if name == option.name else partial(write_clock, parameter=option.parameter)
        values = list(map(convert, values))
    wrong = next((value for value in values if not isinstance(value, str | int | float)), None)
    if wrong is not None:
        raise RequestError(
            f"{mark_parameter(option.parameter)} holds {shorten_value(wrong)}; give numbers or texts.",
            parameter=option.parameter,
        )
    return [part for value in values for part in (_split_text(option, value) if isinstance(value, str) else [value])]


def _split_text(option: PlanOption, text: str) -> list[Any]:
    """The values of a text: separated by commas, and of numbers ranges too."""
    if option.parameter == "tractors":
        assert option.parse is not None
        return list(option.parse(text))
    parts = [part.strip() for part in text.split(",")]
    if "" in parts and any(parts):
        raise RequestError(
            f"{mark_parameter(option.parameter)} {shorten_value(text)} has an empty value between commas or at an "
            "end; give values such as 3,4.5,6.",
            parameter=option.parameter,
        )
    parts = [part for part in parts if part]
    if option.type not in (int, float):
        return parts
    return [value for part in parts for value in _read_numbers(option, part)]


def _read_numbers(option: PlanOption, part: str) -> list[Any]:
    """A number, or those from one to another in steps, both ends among them."""
    found = _RANGE.fullmatch(part)
    try:
        if found is None:
            return [option.type(part)]
        first, last, step = (float(option.type(found[name] or 1)) for name in ("first", "last", "step"))
    except ValueError:
        hint = suggest_number(part, option.help) if option.type is float else ""
        raise RequestError(
            f"{mark_parameter(option.parameter)} holds {shorten_value(part)}, which is no number{hint}; "
            "give numbers (3,4.5,6) or a range (6:12:1, from, to and step).",
            parameter=option.parameter,
        ) from None
    if not (step > 0.0 and last >= first and (last - first) / step < MOST_VALUES):
        raise RequestError(
            f"{mark_parameter(option.parameter)} holds the range {shorten_value(part)}; give from, to and step, the "
            f"step above 0, from no more than to, {MOST_VALUES} values at most.",
            parameter=option.parameter,
        )
    count = int((last - first) / step + 1.0 + ROUNDING)
    return [option.type(round(first + number * step, 9)) for number in range(count)]
