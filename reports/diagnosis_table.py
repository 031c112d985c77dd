"""A diagnosis for the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reports.diagnosis_words import (
    SMALLEST_VISIBLE,
    counted,
    exchange_words,
    gain_text,
    ground_words,
    held_out_words,
    is_calibration,
    left_words,
    likely_words,
    ordered,
    plan_words,
    rest_terms,
    rest_words,
    size_words,
    value_text,
    visible_text,
)
from reports.effect_words import label, spelled
from reports.fitting import Column, FittedTable, sentence
from reports.wording import listed, number
from vehicle.measured.answer.verdict import EQUIVALENT, NAMED, Diagnosis

if TYPE_CHECKING:
    from rich.console import Group

_ERRORS = (
    Column("Pieces"),
    *(Column(f"{name} {who}", f"{name}\n{who}", drop=drop)
      for drop, who in enumerate(("before", "after", "noise")) for name in ("Across", "Along", "Heading")),
)  # fmt: skip
_EFFECTS = (
    Column("Effect", words=True),
    Column("Id in files", words=True, drop=4, whole=True),
    Column("Status", words=True, whole=True),
    Column("Value (95 %)", words=True),
    Column("Gain %", drop=2),
    Column("Smallest visible", drop=3),
)


def diagnosis_table(diagnosis: Diagnosis) -> Group:
    """Verdict, errors, effects and the rest, from top to bottom."""
    from rich.console import Group
    from rich.text import Text

    parts: list[object] = [sentence(spelled(diagnosis.headline), style="bold")]
    parts += [sentence(line) for line in ground_words(diagnosis)]
    parts.append(sentence(f"{size_words(diagnosis)}."))
    if diagnosis.guilty_block:
        parts.append(sentence(f"Guilty block: {diagnosis.guilty_block}."))
    title = (
        f"Error of replayed commands on {held_out_words(diagnosis)} not used for fitting: root mean square over pieces "
        "of that length, each laid on the measurement by its best turn and shift; across and along in cm, heading in "
        "degrees"
    )
    parts += [Text(""), sentence(title, style="italic"), _errors(diagnosis)]
    parts += [Text(""), sentence("Effects", style="italic"), _effects(diagnosis), Text("")]
    parts += [sentence(line) for line in remarks(diagnosis)]
    return Group(*parts)  # type: ignore[arg-type]


def remarks(diagnosis: Diagnosis) -> list[str]:
    """Sentences after the tables: how to read them, the rest, rivals, next drive, what is left, what it changes."""
    lines = [SMALLEST_VISIBLE]
    if any(is_calibration(one) for one in diagnosis.findings):
        lines.append(likely_words())
    rest = diagnosis.tractor.rest
    if rest is not None:
        lines.append(f"The rest: {'; '.join(rest_terms(rest))}. {rest_words(rest)}")
    lines += exchange_words(diagnosis)
    drive = diagnosis.next_drive
    if drive:
        length = counted(round(drive.seconds), "second")
        doubt = "" if drive.decides else " It tells most of the drives that are known, but perhaps not enough."
        rivals = listed(map(label, drive.separates))
        lines.append(f"To tell {rivals} apart: {drive.words} That takes {length}.{doubt}")
    lines += [*left_words(diagnosis), *plan_words(diagnosis)]
    return lines + [spelled(note) for note in diagnosis.notes]


def _errors(diagnosis: Diagnosis) -> FittedTable:
    rows = []
    for horizon, before in diagnosis.before.items():
        trio = (before, diagnosis.after[horizon], diagnosis.floor[horizon])
        cells = ((number(one.cross_cm, 1), number(one.along_cm, 1), number(one.heading_deg, 2)) for one in trio)
        rows.append((f"{horizon:g} s", *(cell for three in cells for cell in three)))
    return FittedTable(_ERRORS, tuple(rows))


def _effects(diagnosis: Diagnosis) -> FittedTable:
    told = ordered(diagnosis.findings)
    rows = tuple(
        (label(one.id), one.id, one.status, value_text(one), gain_text(one), visible_text(one)) for one in told
    )
    styles = tuple("bold" if one.status in (NAMED, EQUIVALENT) else "" for one in told)
    return FittedTable(_EFFECTS, rows, styles)
