"""Many fields in one table: a row for each on a terminal, a row for each of their plans in CSV, all of it in JSON.

A record is what the command keeps of a field: `asked` (its name as given), `width_m`, `refused` (a sentence, or None)
and `ranking` (as `reports.export.ranking_json` writes it, or None).
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from reports.export import CSV_KEYS, DECIMALS, PLAN_KEYS, cell, flat
from reports.fitting import Column, FittedTable, sentence
from reports.plain import finite
from reports.wording import NOTHING, duration, number, percent, price

Record = Mapping[str, Any]
ASKED = "asked"


def csv_head() -> str:
    """The head of the table: of the plan, of what was asked, and the field as it was named."""
    return _csv([(*flat(dict.fromkeys(PLAN_KEYS)), *CSV_KEYS, ASKED)])


def csv_rows(record: Record) -> str:
    """A row for each plan of a field; one with the reason where the field was refused."""
    ranking = record["ranking"]
    none = dict.fromkeys(PLAN_KEYS) | {"feasible": False, "reason": record["refused"]}
    plans = [{key: plan[key] for key in PLAN_KEYS} for plan in (ranking["plans"] if ranking else [none])]
    asked = ranking["scenario"] if ranking else {"width_m": record["width_m"]}
    same = [cell(finite(asked.get(key), DECIMALS)) for key in CSV_KEYS]
    return _csv([*map(cell, flat(plan).values()), *same, record[ASKED]] for plan in plans)


def _csv(rows: Iterable[Sequence[Any]]) -> str:
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    return buffer.getvalue()


def many_json(records: Sequence[Record]) -> str:
    """``fields``: records without their key, in the order they were asked for."""
    shown = [{key: value for key, value in record.items() if key != "key"} for record in records]
    return json.dumps({"fields": shown}, indent=2, ensure_ascii=False) + "\n"


def many_table(records: Sequence[Record]) -> RenderableType:
    """The best plan of every field at every width, and what was refused and why."""
    chances = any((_best(record) or {}).get("finish_probability") is not None for record in records)
    shown = len(_COLUMNS) - (not chances)
    rows = tuple(_row(record)[:shown] for record in records)
    parts: list[RenderableType] = [FittedTable(_COLUMNS[:shown], rows)]
    legend = "The best plan of each field. Times are h:mm:ss; headland in metres, bearing in degrees from north."
    parts += [sentence(text, style="dim") for text in (legend, *_money_words(records))]
    without = [record for record in records if not _best(record)]
    if without:
        parts += [Text(""), Text(f"Without a plan: {len(without)} of {len(records)}", style="bold underline")]
        parts += [sentence(f"{record[ASKED]} at {record['width_m']:g} m: {_why(record)}") for record in without]
    return Group(*parts)


def _money_words(records: Sequence[Record]) -> list[str]:
    """What the costs are, where plans were drawn or a farm has a currency."""
    best = [plan for record in records if (plan := _best(record))]
    units = sorted({record["ranking"].get("currency") or "" for record in records if record["ranking"]} - {""})
    drawn = any(plan.get("expected_cost") is not None for plan in best)
    what = "expected, in the mean of the draws, with what ground loses that is late" if drawn else "as simulated"
    return [f"Cost: {what}{f', in {units[0]}' if len(units) == 1 else ''}."] if drawn or units else []


_COLUMNS = (
    Column("Field", words=True),
    Column("ha"),
    Column("Width"),
    Column("Headland", "Head-\nland", drop=4),
    Column("Bearing", "Bea-\nring", drop=3),
    Column("Strategy", words=True, whole=True),
    Column("Tractors", "Trac-\ntors"),
    Column("Time"),
    Column("Worked %", "Work\n%", drop=2),
    Column("Cost", drop=1),
    Column("In time %", "In\ntime %", drop=5),
)


def _best(record: Record) -> Mapping[str, Any] | None:
    ranking = record["ranking"]
    best: Mapping[str, Any] | None = ranking["best"] if ranking else None
    return best


def _why(record: Record) -> str:
    """Why a field has no plan, in a sentence."""
    if record["refused"]:
        return str(record["refused"])
    reasons = [plan["reason"] for plan in record["ranking"]["plans"] if plan["reason"]]
    return f"no plan is feasible; the first of {len(reasons)} reasons: {reasons[0]}."


def _row(record: Record) -> tuple[str, ...]:
    best, ranking = _best(record), record["ranking"]
    name = ranking["field"]["name"] if ranking else PurePath(record[ASKED]).name
    asked = ranking["scenario"] if ranking else {}
    plan: Mapping[str, Any] = best or {}
    return (
        name,
        number(ranking["field"]["area_ha"], 2) if ranking else NOTHING,
        f"{record['width_m']:g}",
        number(asked.get("headland_m"), 1),
        number(asked.get("bearing_deg"), 0),
        plan.get("strategy", "none"),
        str(plan.get("tractors", NOTHING)),
        duration(plan.get("time_s")),
        number(plan.get("worked_pct"), 1),
        price(plan.get("cost") if plan.get("expected_cost") is None else plan["expected_cost"]),
        percent(plan.get("finish_probability")),
    )
