"""Heights under a map: shading as a picture, and contours."""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING

import numpy as np

from reports.common import palette
from reports.common.plan_drives import Relief

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import PathPatch

SHADE_OPACITY = 0.45


def draw_relief(axes: Axes, relief: Relief, field_patch: PathPatch) -> None:
    """Shading and contours inside the patch of a field."""
    from matplotlib.collections import LineCollection

    west, south, east, north = relief.bounds_m
    picture = axes.imshow(
        relief.shade, cmap="gray", vmin=0.0, vmax=1.0, alpha=SHADE_OPACITY, extent=(west, east, south, north),
        origin="lower", interpolation="bilinear", zorder=1.2, aspect="equal",
    )  # fmt: skip
    lines = LineCollection(
        [points for _, points in relief.contours], colors=palette.CONTOUR_COLOUR, linewidths=0.5, zorder=1.8
    )
    axes.add_collection(lines, autolim=False)
    for artist in (picture, lines):
        artist.set_clip_path(field_patch)


def name_relief(relief: Relief) -> str:
    """What a legend calls it."""
    return f"contours every {relief.interval_m:g} m"


def encode_shade(relief: Relief) -> str:
    """The shading as a grey PNG in a data URL, north up."""
    from PIL import Image

    grey = np.rint(255.0 * np.clip(relief.shade[::-1], 0.0, 1.0)).astype(np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(grey).save(buffer, format="PNG", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"
