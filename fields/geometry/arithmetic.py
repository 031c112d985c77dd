"""Arithmetic of geometry: a tolerance for each kind of error, the smallest sizes that count in a field, and sums that
are the same on every processor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy.typing as npt

GRID_M = 1e-6  # of overlays, without which GEOS leaves slivers along nearly coincident edges; less is rounding
ROUNDING = 1e-9  # relative, of computed lengths, areas and degrees that are the same but for their order of terms
PARALLEL_RAD = 1e-6  # directions that differ by less are one
SLIVER_M2 = 1e-6  # left by cutting
EDGE_M = 1e-3  # by which lines that lie on an edge may miss it: a millimetre of what was drawn
CURVE_M = 0.05  # by which a curve may be drawn by straight pieces: a guidance line is no better
MITRE_LIMIT, SHARP_MITRE_LIMIT = 2.0, 20.0
"""Of grown outlines: corners are cut at twice the distance; the sharp ones of a headland still count as worked."""
MIN_SWATH_LENGTH_M = 5.0  # of swaths laid without being asked for: less than a tractor is long
NEAR_FIELD_M = 50.0  # gates, hoses, heights and drawn features so far outside still belong to the field
MACHINE_WIDTH_M = 3.0  # narrower openings let nothing through, and lines nearer to the outline lie on it


def multiply(a: npt.ArrayLike, b: npt.ArrayLike) -> Any:
    """What `a @ b` is for a of shape (..., k) and b of shape (k,) or (k, m): a float or an array of floats.

    BLAS, which `@` asks, adds in the order and with the rounding that suit the processor.
    """
    import numpy as np

    right = np.asarray(b, dtype=float)
    product = np.einsum("...j,jk->...k" if right.ndim == 2 else "...j,j->...", np.asarray(a, dtype=float), right)
    return product if product.ndim else float(product)
