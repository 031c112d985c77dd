"""What counts as the picture of a tile: PNG, JPEG or WebP of a usual size, told by its bytes and not by its name."""

from __future__ import annotations

import io

import numpy as np
import numpy.typing as npt

from planner.service.errors import ServiceError

MOST_TILE_BYTES = 2 * 2**20
MOST_SIDE_PX = 1024
MEDIA_BY_FORMAT = {"PNG": "image/png", "JPEG": "image/jpeg", "WEBP": "image/webp"}


class TileError(ServiceError):
    """A tile that cannot be had now, or is no picture."""

    http_status = 503


def identify_tile(content: bytes) -> str:
    """The media type of a tile; raises TileError for anything but a small picture. Only its header is read."""
    from PIL import Image, UnidentifiedImageError

    if len(content) > MOST_TILE_BYTES:
        raise TileError(f"A tile of the background is larger than {MOST_TILE_BYTES // 2**20} MB; use another server.")
    try:
        with Image.open(io.BytesIO(content), formats=list(MEDIA_BY_FORMAT)) as image:
            width, height, name = image.width, image.height, str(image.format)
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        raise TileError(
            "The background sent something other than a PNG, JPEG or WebP picture; check its address."
        ) from None
    if max(width, height) > MOST_SIDE_PX:
        raise TileError(
            f"A tile of the background has {width} x {height} pixels; use a server whose tiles have at most "
            f"{MOST_SIDE_PX} x {MOST_SIDE_PX}."
        )
    return MEDIA_BY_FORMAT[name]


def encode_png(pixels: npt.NDArray[np.uint8]) -> bytes:
    """PNG of an array of shape (rows, columns, 4), 8 bits."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG", compress_level=3)
    return stream.getvalue()
