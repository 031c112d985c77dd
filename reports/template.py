"""Pages from templates: every page has the head, the style and the foot of `base.html.j2`."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from reports import palette


def rendered(name: str, content: Mapping[str, Any]) -> str:
    """A page as HTML text: the template `name` of this package filled with `content`, values escaped."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    room = files("reports")
    environment = Environment(
        loader=FunctionLoader(lambda part: room.joinpath(part).read_text(encoding="utf-8")),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    colours = {
        "states": list(palette.STATES),
        "state_colours": palette.STATES,
        "tractor_colours": list(zip(palette.TRACTORS, palette.TRACTORS_ON_DARK, strict=True)),
    }
    return environment.get_template(name).render({**colours, **content}).rstrip() + "\n"
