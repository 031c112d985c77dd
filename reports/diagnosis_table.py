"""A diagnosis for the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vehicle.measured.verdict import EQUIVALENT, NAMED, Diagnosis, Finding

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table


def value_text(one: Finding) -> str:
    """Value of the size with its interval, or nothing."""
    if one.value is None:
        return ""
    name = next(iter(one.value))
    text = f"{one.value[name]:.3g}"
    if one.interval and name in one.interval:
        low, high = one.interval[name]
        text += f" ({low:.3g} to {high:.3g})"
    return f"{text} {one.unit}".strip()


def visible_text(one: Finding) -> str:
    """Smallest visible size."""
    return "none" if one.smallest_visible is None else f"{one.smallest_visible:.2g} {one.unit}".strip()


def diagnosis_table(diagnosis: Diagnosis) -> Group:
    """Verdict, errors, effects and the rest, from top to bottom."""
    from rich.console import Group
    from rich.text import Text

    parts: list[object] = [
        Text(diagnosis.headline, style="bold"),
        Text(
            f"{len(diagnosis.names)} runs, {diagnosis.minutes:.1f} minutes, {diagnosis.rows_used} rows used, "
            f"{diagnosis.rows_gated} left out."
        ),
    ]
    if diagnosis.guilty_block:
        parts.append(Text(f"Guilty block: {diagnosis.guilty_block}."))
    parts += [_errors(diagnosis), _effects(diagnosis)]
    parts += [Text(line) for line in remarks(diagnosis)]
    return Group(*parts)  # type: ignore[arg-type]


def remarks(diagnosis: Diagnosis) -> list[str]:
    """Sentences after the tables: rivals, next drive, what is left, what it gains."""
    found = [f"{one.id}: {one.exchange}." for one in diagnosis.findings if one.exchange and one.interval]
    if diagnosis.next_drive:
        drive = diagnosis.next_drive
        found.append(f"To tell {' and '.join(drive.separates)} apart: {drive.words} ({drive.seconds:.0f} s)")
    if diagnosis.depends_on:
        found.append(
            f"Unexplained: {100 * diagnosis.unexplained_share:.0f} % of the error; "
            f"{' and '.join(diagnosis.depends_on)}."
        )
    plan = diagnosis.plan
    if plan and plan.time_before_s and plan.time_after_s:
        found.append(
            f"A plan for the field {plan.field} by one tractor: {plan.time_before_s / 60:.1f} min as the file says, "
            f"{plan.time_after_s / 60:.1f} min with what was found; off the tracks {plan.lateral_before_cm:.1f} cm and "
            f"{plan.lateral_after_cm:.1f} cm."
        )
    return [*found, *diagnosis.notes]


def _errors(diagnosis: Diagnosis) -> Table:
    from rich.table import Table

    table = Table(title="Error of replayed commands on runs not used for fitting", title_justify="left")
    table.add_column("Over")
    for name in ("before", "after", "noise"):
        table.add_column(f"{name}: across, along cm; heading deg", justify="right")
    for horizon, before in diagnosis.before.items():
        cells = [
            f"{one.cross_cm:.1f}, {one.along_cm:.1f}; {one.heading_deg:.2f}"
            for one in (before, diagnosis.after[horizon], diagnosis.floor[horizon])
        ]
        table.add_row(f"{horizon:g} s", *cells)
    return table


def _effects(diagnosis: Diagnosis) -> Table:
    from rich.table import Table

    table = Table(title="Effects", title_justify="left")
    for name in ("Effect", "Status", "Value (95 %)", "Gain %", "Smallest visible"):
        table.add_column(name, justify="left" if name in ("Effect", "Status") else "right")
    for one in diagnosis.findings:
        style = "bold" if one.status in (NAMED, EQUIVALENT) else None
        gain = f"{one.gain_pct:.0f}" if one.interval else ""
        table.add_row(one.id, one.status, value_text(one), gain, visible_text(one), style=style)
    return table
