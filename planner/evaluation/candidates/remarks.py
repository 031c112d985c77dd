"""Remarks on a plan that can be driven, in the order of what they can cost whoever drives it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum


class Stake(IntEnum):
    """What a remark puts at stake, the worst first."""

    LIFE = 0
    GROUND_OF_OTHERS = 1
    MACHINES = 2
    WORK = 3
    TIME = 4
    NOTHING = 5


@dataclass(frozen=True)
class Remark:
    """A sentence without its full stop, and what it puts at stake."""

    stake: Stake
    text: str


def sort_remarks(remarks: Iterable[Remark]) -> tuple[str, ...]:
    """The sentences, those on the worst first, else as they came."""
    return tuple(remark.text for remark in sorted(remarks, key=lambda remark: remark.stake))
