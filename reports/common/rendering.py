"""Results for people and programs: pages from templates, views in notebooks, plain values for JSON and CSV.

A result type inherits from `ShownResult`, and a view of it is registered with `build_view` beside its tables and
figures, so that the types themselves stay plain data.
"""

from __future__ import annotations

import base64
import csv
import io
import json
import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from functools import singledispatch
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fields.errors import HeadlandError
from reports.common import palette
from reports.common.drawing_sizes import COLUMN_INCHES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

EXPORT_DECIMALS = 6
METRE_DECIMALS = 2  # of files with many places or legs
MOST_SUMMARY_CHARS = 280
MOST_PICTURE_BYTES = 200_000  # base64 makes a third more of it; a fragment stays below 300 kB
PICTURE_COLOURS = 64
PICTURE_DPIS = (120, 90, 60, 30)  # the sharpest that is small enough is taken
FIGURE_INCHES = (COLUMN_INCHES, 5.0)
NOT_DRAWN = "There is nothing to draw"

Draw = Callable[["Axes"], None]


class ReportError(HeadlandError):
    """A result that cannot be drawn or written.

    The message is one sentence: the value, the rule it breaks, and the fix.
    """


def make_json_safe(value: Any, decimals: int | None = None) -> Any:
    """Plain Python values: dataclasses by their fields, numpy values unpacked, tuples as lists, keys as text, floats
    that are not finite as None.

    With `decimals` floats are rounded, and -0.0 becomes 0.0.
    """
    if is_dataclass(value):
        value = pick_values(value, [field.name for field in fields(value)])
    if isinstance(value, Mapping):
        items = ((f"{key:g}" if isinstance(key, float) else str(key), item) for key, item in value.items())
        return {key: make_json_safe(item, decimals) for key, item in items}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [make_json_safe(item, decimals) for item in value]
    if isinstance(value, float):
        if not math.isfinite(value):
            return None
        return value if decimals is None else round(value, decimals) + 0.0
    return value


def pick_values(one: Any, keys: Iterable[str]) -> dict[str, Any]:
    """Attributes of a result by their names, as files have them."""
    return {key: getattr(one, key) for key in keys}


def format_json(data: Any, decimals: int | None = None, *, is_ascii: bool = True) -> str:
    """Values as JSON text with a trailing newline, made safe by `make_json_safe`."""
    return json.dumps(make_json_safe(data, decimals), indent=2, ensure_ascii=is_ascii, allow_nan=False) + "\n"


def format_csv(columns: Sequence[str], entries: Iterable[Any]) -> str:
    """A header and a row per entry (a mapping or a result), made safe by `make_json_safe`, as CSV text.

    Cells are empty where an entry lacks a column or has None in it; truth values are ``true`` and ``false``, and lines
    end in a newline alone.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(columns)
    for entry in make_json_safe(list(entries), EXPORT_DECIMALS):
        values = [entry.get(name) for name in columns]
        writer.writerow([str(value).lower() if isinstance(value, bool) else value for value in values])
    return buffer.getvalue()


def render_template(name: str, content: Mapping[str, Any]) -> str:
    """A page as HTML text: the template `name` of the package reports filled with `content`, values escaped."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    package_files = files("reports")
    environment = Environment(
        loader=FunctionLoader(lambda part: package_files.joinpath(part).read_text(encoding="utf-8")),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    colours = {
        "states": list(palette.STATE_COLOURS),
        "state_colours": palette.STATE_COLOURS,
        "tractor_colours": list(zip(palette.TRACTOR_COLOURS, palette.DARK_TRACTOR_COLOURS, strict=True)),
    }
    return environment.get_template(name).render({**colours, **content}).rstrip() + "\n"


@dataclass(frozen=True)
class ResultView:
    """How one result is shown; each part is made only when it is asked for.

    `summary` is one sentence or a few, `table` has a row per plan, job or effect, as mappings or as a data frame,
    `files` makes the content of a file by its ending (".json"). Without `draw`, `not_drawn` says why there is no
    picture.
    """

    summary: Callable[[], str]
    html: Callable[[], str]
    table: Callable[[], Sequence[Mapping[str, Any]] | DataFrame]
    draw: Draw | None = None
    not_drawn: str = f"{NOT_DRAWN}."
    figure_inches: tuple[float, float] = FIGURE_INCHES
    files: Mapping[str, Callable[[], str | bytes]] = field(default_factory=dict)


@singledispatch
def build_view(result: object) -> ResultView:
    """The view of a result; raises ReportError for a type without one."""
    name = type(result).__name__
    raise ReportError(f"A {name} has no view; import the part of planner that made it.")


class ShownResult:
    """A result that notebooks show and that goes on to pandas, matplotlib and files."""

    def get_view(self) -> ResultView:
        """How this result is shown."""
        return build_view(self)

    def __repr__(self) -> str:
        """The answer in one to three lines."""
        try:
            summary = " ".join(self.get_view().summary().split())
        except ReportError:
            summary = "..."
        if len(summary) > MOST_SUMMARY_CHARS:
            summary = f"{summary[: MOST_SUMMARY_CHARS - 4].rsplit(' ', 1)[0]} ..."
        return f"<{type(self).__name__}: {summary}>"

    def _repr_html_(self) -> str:
        """The answer, a picture and a table, for a notebook."""
        return self.get_view().html()

    def to_pandas(self) -> DataFrame:
        """The rows of the result, with units in the names of the columns."""
        import pandas as pd

        return pd.DataFrame(self.get_view().table())

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the result on `ax`, or on axes of a figure of its own, and return the axes.

        In a notebook the new figure is one of pyplot, so that it appears below the cell. Raises ReportError where there
        is nothing to draw.
        """
        view = self.get_view()
        if view.draw is None:
            raise ReportError(view.not_drawn)
        if ax is None and "ipykernel" in sys.modules:
            from matplotlib import pyplot

            ax = pyplot.figure(figsize=view.figure_inches, layout="constrained").add_subplot()
        elif ax is None:
            ax = create_figure(*view.figure_inches, layout="constrained").add_subplot()
        view.draw(ax)
        return ax

    def save(self, path: str | Path) -> Path:
        """Write the result to a file, in the form that the ending of its name says, and return its path.

        Raises ReportError for an ending that is not known, and OSError where the file cannot be written.
        """
        place, files = Path(path), self.get_view().files
        make = files.get(place.suffix.lower())
        if make is None:
            raise ReportError(
                f"{place.name!r} does not say what to write; give a name that ends in {' or '.join(files)}."
            )
        content = make()
        place.write_bytes(content if isinstance(content, bytes) else content.encode())
        return place


def create_figure(width_inches: float, height_inches: float, **look: Any) -> Figure:
    """A figure that is drawn without a display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_inches, height_inches), **look)
    FigureCanvasAgg(figure)
    return figure


def draw_legend(place: Axes | Figure, axes: Axes, **look: Any) -> None:
    """A legend on a figure or axes with one entry for every label of `axes`, without a frame."""
    handles, labels = axes.get_legend_handles_labels()
    entries = dict(zip(labels, handles, strict=True))
    place.legend(entries.values(), entries.keys(), frameon=False, **look)


def encode_picture(draw: Draw, figure_inches: tuple[float, float] = FIGURE_INCHES) -> str:
    """A drawing on axes of a figure as PNG in base64."""
    figure = create_figure(*figure_inches, layout="constrained", facecolor="white")
    draw(figure.add_subplot())
    return encode_figure(figure)


def encode_figure(figure: Figure) -> str:
    """A figure as PNG in base64, as sharp as MOST_PICTURE_BYTES allows.

    A map has few colours, so a palette of PICTURE_COLOURS makes the picture a third as large.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas, content = FigureCanvasAgg(figure), b""
    for dpi in PICTURE_DPIS:
        figure.set_dpi(dpi)
        canvas.draw()
        buffer = io.BytesIO()
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
        picture.quantize(PICTURE_COLOURS, dither=Image.Dither.NONE).save(buffer, format="PNG", optimize=True)
        content = buffer.getvalue()
        if len(content) <= MOST_PICTURE_BYTES:
            break
    return base64.b64encode(content).decode("ascii")
