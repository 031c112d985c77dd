"""`python -m tests.benchmarks.attack`: see the package."""

import argparse
import json
import shlex
import sys
from pathlib import Path

from tests.benchmarks.attack.rows import format_table, list_rows
from tests.benchmarks.attack.running import ITEMS, attack

COMMAND = shlex.join((sys.executable, "-c", "from planner.cli.main import main; main()", "serve"))


def main() -> int:
    """Attack and print; 1 where something did not hold."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.attack", description="Attack a service.")
    parser.add_argument("--only", type=_parse_items, default=ITEMS, help="items to attack, such as 2,3")
    parser.add_argument("--short", action="store_true", help="small numbers, as in tests")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("--before", type=Path, help="JSON of an earlier run, shown beside the figures of this one")
    parser.add_argument("--command", default=COMMAND, help="what starts the service; ends in serve")
    given = parser.parse_args()
    if shlex.split(given.command)[-1:] != ["serve"]:
        parser.error("--command ends in the word serve, such as '/opt/headland/bin/headland serve'")
    rows = attack(shlex.split(given.command), given.only, short=given.short)
    before = json.loads(given.before.read_text(encoding="utf-8")) if given.before else ()
    print(json.dumps(list_rows(rows), indent=1) if given.json else format_table(rows, before))
    return int(any(row.held is False for row in rows))


def _parse_items(text: str) -> tuple[int, ...]:
    items = tuple(int(each) for each in text.split(","))
    if not set(items) <= set(ITEMS):
        raise argparse.ArgumentTypeError(f"items are {', '.join(map(str, ITEMS))}")
    return items


if __name__ == "__main__":
    sys.exit(main())
