"""A running service is attacked from outside, in the short form: everything holds."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.benchmarks.attack.rows import Row, format_table
from tests.benchmarks.attack.running import ITEMS

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
@pytest.mark.parametrize("items", [(5,), pytest.param(ITEMS, marks=pytest.mark.matrix)], ids=str)
def test_everything_holds_while_a_running_service_is_attacked_from_outside(items: tuple[int, ...]) -> None:
    """Figures are times: what other tests, which run beside it, have spoilt must hold when it is attacked again.

    In every run of CI, links through a proxy; what the other attacks try has tests of its own.
    """
    rows = attack("--only", ",".join(map(str, items)))
    assert {int(row["item"].rstrip("abcdef")) for row in rows} == set(items)
    broken = {row["item"].rstrip("abcdef") for row in rows if row["held"] is False}
    again = [row for row in attack("--only", ",".join(sorted(broken))) if row["held"] is False] if broken else []
    assert not again, json.dumps(again, indent=1)


def attack(*more: str) -> list[dict[str, Any]]:
    """The rows of one run."""
    command = [sys.executable, "-m", "tests.benchmarks.attack", "--short", "--json", *more]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=900)
    rows: list[dict[str, Any]] = json.loads(done.stdout)
    return rows


def test_a_table_of_rows_has_at_most_100_columns() -> None:
    rows = [Row("1a", "what was attacked " * 9, "a figure " * 20, "a limit " * 9, False)]
    for table in (format_table(rows), format_table(rows, [{"item": "1a", "figure": "another figure " * 9}])):
        assert "NOT HELD" in table and max(map(len, table.splitlines())) <= 100
