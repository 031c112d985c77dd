"""The page of the implements whose draft is known, made from the table of drafts."""

from __future__ import annotations

from vehicle.energy.draft import DraftRule, load_draft_rules

INTRODUCTION = """# Implements and their draft

`headland plan --draft NAME --depth-cm DEPTH` plans with one of these implements; a farm file names it under
`[[implements]]` as `draft = "plough"` and `depth_cm = 20.0`. Without a name, `till` is the cultivator, and `sow` the
drill of its width. Draft is F (A + B v + C v2) W T (ASABE D497): v in km/h, W in the unit of the row, T the depth in cm
where one stands here; see [soil and energy](soil-and-energy.md). Depths are usual ones with the range that can be asked
for, and units lie as far apart as is usual; neither is the standard's.

| name | implement | depth, cm | unit | A, B, C | F fine, medium, coarse | range, % |
|---|---|---|---|---|---|---|
"""


def build_implements_page() -> str:
    """Markdown with a line per implement, in the order of the table."""
    return INTRODUCTION + "".join(_build_row(rule) for rule in load_draft_rules().values())


def _build_row(rule: DraftRule) -> str:
    depth = (
        f"{rule.depth_cm:g} ({rule.min_depth_cm:g} to {rule.max_depth_cm:g})" if rule.follows_depth else "whole depth"
    )
    unit = "m" if rule.unit == "m" else f"{rule.unit.removesuffix('s')}, {rule.spacing_m:g} m apart"
    cells = (
        f"`{rule.name}`",
        rule.implement,
        depth,
        unit,
        f"{rule.a:g}, {rule.b:g}, {rule.c:g}",
        f"{rule.fine:g}, {rule.medium:g}, {rule.coarse:g}",
        f"{rule.range_pct:g}",
    )
    return f"| {' | '.join(cells)} |\n"
