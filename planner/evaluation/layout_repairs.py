"""What planning changes by itself where plans cannot be driven as asked: wider margins at single obstacles, more
headland, and pieces left out that cannot be reached.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from fields.geometry.field import Field
from reports.common.plan_results import FENCE, NO_PATH, OBSTACLE, OUTLINE, PlanFault

MARGIN_STEPS_M = (0.5, 0.7, 1.0, 1.5, 2.0, 3.0)
MAX_EXTRA_PASSES = 1


@dataclass(frozen=True)
class LayoutRepairs:
    """Changes to the planning of one field.

    `margins_m` are margins (m) to keep by the number of an obstacle (Field.solid_obstacles, then fences), where they
    are wider than that of the request. `extra_passes` are added to the headland. With `skips_unreachable` swaths that
    no path leads to are left out, however many they are.
    """

    margins_m: Mapping[int, float] = field(default_factory=dict)
    extra_passes: int = 0
    skips_unreachable: bool = False

    def extend(
        self, faults: Iterable[PlanFault], margin_m: float, *, may_deepen: bool = True, may_skip: bool = True
    ) -> LayoutRepairs:
        """The repairs with the next change for each fault; the same ones if there is none left to try.

        With `may_deepen` the headland may get another pass, with `may_skip` swaths may be left out.
        """
        margins_m, extra_passes, skips_unreachable = dict(self.margins_m), self.extra_passes, self.skips_unreachable
        for fault in faults:
            if fault.kind in (OBSTACLE, FENCE) and fault.number is not None:
                kept_m = self.margins_m.get(fault.number, margin_m)
                margins_m[fault.number] = next((step for step in MARGIN_STEPS_M if step > kept_m + 1e-6), kept_m)
            elif fault.kind in (OUTLINE, NO_PATH) and may_deepen and self.extra_passes < MAX_EXTRA_PASSES:
                extra_passes = self.extra_passes + 1
            elif fault.kind == NO_PATH and may_skip:
                skips_unreachable = True
        return replace(self, margins_m=margins_m, extra_passes=extra_passes, skips_unreachable=skips_unreachable)

    def describe(self, field: Field) -> list[str]:
        """Remarks on what was chosen."""
        names = [*field.obstacle_names, *["the fence"] * len(field.fences)]
        by_margin: dict[float, list[str]] = {}
        for number, margin_m in sorted(self.margins_m.items()):
            by_margin.setdefault(margin_m, []).append(names[number])
        remarks = [f"keeps {margin_m:g} m from {join_names(by_margin[margin_m])}" for margin_m in sorted(by_margin)]
        if self.extra_passes:
            remarks.append("one more headland pass, for room to turn")
        return remarks


NO_REPAIRS = LayoutRepairs()


def join_names(names: Sequence[str]) -> str:
    """The first two different names, and how many more there are."""
    shown = list(dict.fromkeys(names))
    if len(shown) == 1:
        return shown[0] if len(names) == 1 else f"{shown[0]} ({len(names)} of them)"
    if len(shown) > 3:
        shown = [*shown[:2], f"{len(shown) - 2} more"]
    return f"{', '.join(shown[:-1])} and {shown[-1]}"
