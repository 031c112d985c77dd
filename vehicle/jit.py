"""The one setting with which every formula of this room is compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile on first call and keep the result on disk; IEEE arithmetic, so that runs repeat bit for bit."""
    return cast(Function, numba.njit(cache=True, error_model="numpy")(function))
