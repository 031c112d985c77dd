"""The page of all options of a plan, made from the request model."""

from __future__ import annotations

from itertools import groupby
from typing import Any

from planner.request.options import RequestOption, list_options
from planner.request.plan_request import PlanRequest

INTRODUCTION = """# Options of a plan

`headland plan` takes these options; jobs of `/api/v1/plans` take the same names with underscores; Python takes the
parameters of `PlanRequest`, in SI units. A farm file may set those marked with *.
"""


def build_options_page() -> str:
    """Markdown with a table per panel of `headland plan --help`."""
    options = sorted(list_options(PlanRequest), key=lambda option: _list_panels().index(option.rules.panel))
    parts = [INTRODUCTION]
    for panel, members in groupby(options, key=lambda option: option.rules.panel):
        parts.append(f"## {panel or 'Field'}\n\n| option | parameter | default | meaning |\n|---|---|---|---|")
        parts.append("\n".join(_build_row(option) for option in members) + "\n")
    return "\n".join(parts)


def _list_panels() -> list[str]:
    """Panels in the order in which the model names them."""
    return list(dict.fromkeys(option.rules.panel for option in list_options(PlanRequest)))


def _build_row(option: RequestOption) -> str:
    cells = (
        f"`{_name_option(option.name)}`{' *' if option.rules.from_farm else ''}",
        f"`{option.parameter}`",
        _format_default(option.default),
        option.format_help(_name_option),
    )
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _name_option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _format_default(default: Any) -> str:
    if default is None or default == () or default is False:
        return ""
    return f"`{','.join(map(str, default)) if isinstance(default, tuple) else default}`"
