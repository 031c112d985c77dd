"""One core for linear algebra on small matrices, where threads cost more than they bring."""

from __future__ import annotations

import os

_SWITCHES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def one_thread() -> None:
    """Ask the linear algebra libraries for one thread; only heard before numpy is loaded."""
    for name in _SWITCHES:
        os.environ.setdefault(name, "1")
