"""A diagnosis for the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reports.diagnosis_words import (
    FITTED,
    SMALLEST_VISIBLE,
    counted,
    exchange_words,
    gain_text,
    ground_words,
    held_out_words,
    is_calibration,
    ordered,
    plan_words,
    rest_terms,
    rest_words,
    size_words,
    status_words,
    unexplained_words,
    value_text,
    visible_text,
)
from reports.wording import number
from vehicle.measured.answer.verdict import EQUIVALENT, NAMED, Diagnosis

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table


def diagnosis_table(diagnosis: Diagnosis) -> Group:
    """Verdict, errors, effects and the rest, from top to bottom."""
    from rich.console import Group
    from rich.text import Text

    parts: list[object] = [Text(diagnosis.headline, style="bold")]
    parts += [Text(line) for line in ground_words(diagnosis)]
    parts.append(Text(f"{size_words(diagnosis)}."))
    if diagnosis.guilty_block:
        parts.append(Text(f"Guilty block: {diagnosis.guilty_block}."))
    parts += [_errors(diagnosis), _effects(diagnosis)]
    parts += [Text(line) for line in remarks(diagnosis)]
    return Group(*parts)  # type: ignore[arg-type]


def remarks(diagnosis: Diagnosis) -> list[str]:
    """Sentences after the tables: how to read them, the rest, rivals, next drive, what is left, what it changes."""
    found = [SMALLEST_VISIBLE]
    if any(is_calibration(one) for one in diagnosis.findings):
        found.append(f"{FITTED.capitalize()}: it lowers the error, but these logs do not show that it is the cause.")
    rest = diagnosis.tractor.rest
    if rest is not None:
        found.append(f"The rest: {'; '.join(rest_terms(rest))}. {rest_words(rest)}")
    found += exchange_words(diagnosis)
    drive = diagnosis.next_drive
    if drive:
        length = counted(round(drive.seconds), "second")
        doubt = "" if drive.decides else " It tells most of the drives that are known, but perhaps not enough."
        found.append(f"To tell {' and '.join(drive.separates)} apart: {drive.words} That takes {length}.{doubt}")
    return [*found, unexplained_words(diagnosis), *plan_words(diagnosis), *diagnosis.notes]


def _errors(diagnosis: Diagnosis) -> Table:
    from rich.table import Table

    title = (
        f"Error of replayed commands on {held_out_words(diagnosis)} not used for fitting: root mean square over pieces "
        "of that length, each laid on the measurement by its best turn and shift; across and along in cm, heading in "
        "degrees"
    )
    table = Table(title=title, title_justify="left")
    table.add_column("Pieces", no_wrap=True)
    for name in ("before", "after", "noise"):
        table.add_column(f"{name}: across, along; heading", justify="right")
    for horizon, before in diagnosis.before.items():
        cells = [
            f"{one.cross_cm:.1f}, {one.along_cm:.1f}; {number(one.heading_deg, 2)}"
            for one in (before, diagnosis.after[horizon], diagnosis.floor[horizon])
        ]
        table.add_row(f"{horizon:g} s", *cells)
    return table


def _effects(diagnosis: Diagnosis) -> Table:
    from rich.table import Table

    table = Table(title="Effects", title_justify="left")
    for name in ("Effect", "Status", "Value (95 %)", "Gain %", "Smallest visible"):
        words = name in ("Effect", "Status")
        table.add_column(name, justify="left" if words else "right", no_wrap=words, overflow="fold")
    for one in ordered(diagnosis.findings):
        style = "bold" if one.status in (NAMED, EQUIVALENT) else None
        cells = (one.id, status_words(one), value_text(one), gain_text(one), visible_text(one))
        table.add_row(*cells, style=style)
    return table
