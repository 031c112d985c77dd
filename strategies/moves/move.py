"""A move from the end of one work line to the begin of another."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from fields.arrays import Floats
from strategies.path_planning.paths import DrivePath, Pose, build_path_from_rows


@dataclass(frozen=True, eq=False)
class Move:
    """One way from a pose to another.

    Attributes:
        start: pose of the guided point where it begins.
        rows: its segments (k, 3): length m, curvature 1/m, gear.
        kind: as of a path.
        drive_s: seconds, as planned or once driven as measured; less what it saves on the lines that it cuts.
        charge_s: for what a driver avoids, for wheels on kept ground, and for ground left unworked.
        settling_s: charge for ground missed as the next line is begun beside it, as expected or as measured.
        leave_m, join_m: by how much the line left is lifted early, and the line begun is lowered late.
        is_work: whether the implement stays down.
        is_folded: whether it is folded on the way: the tractor stands to fold before it and to unfold after it.
        begins_folded: whether it is folded already.
    """

    start: Pose
    rows: Floats
    kind: str
    drive_s: float
    charge_s: float = 0.0
    settling_s: float = 0.0
    leave_m: float = 0.0
    join_m: float = 0.0
    is_work: bool = False
    is_folded: bool = False
    begins_folded: bool = False

    @property
    def cost_s(self) -> float:
        """Seconds with all charges."""
        return self.drive_s + self.charge_s + self.settling_s

    @cached_property
    def path(self) -> DrivePath:
        """Its path, segments of no length left out."""
        return build_path_from_rows(self.start, self.rows, self.kind)
