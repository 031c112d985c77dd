"""Sums of products that come out the same on every processor, so that a plan does."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


def multiply(a: npt.ArrayLike, b: npt.ArrayLike) -> Any:
    """What `a @ b` is for a of shape (..., k) and b of shape (k,) or (k, m): a float or an array of floats.

    BLAS, which `@` asks, adds in the order and with the rounding that suit the processor.
    """
    right = np.asarray(b, dtype=float)
    product = np.einsum("...j,jk->...k" if right.ndim == 2 else "...j,j->...", np.asarray(a, dtype=float), right)
    return product if product.ndim else float(product)
