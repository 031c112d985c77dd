"""Headland by its own name: `import headland` offers what `import planner` does, as the very same objects.

    import headland

    answer = headland.plan(headland.PlanRequest(field="denmark", tractors=(1, 2)))

help(headland.plan) says what comes back; `python -m headland` is the command line.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import planner

if TYPE_CHECKING:
    from planner import *  # noqa: F403

__all__ = planner.__all__


def __getattr__(name: str) -> Any:
    return getattr(planner, name)


def __dir__() -> list[str]:
    return dir(planner)
