"""All attacks in order: which needs what, and what becomes of one that breaks."""

import sys
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial

from tests.benchmarks.attack.access import attack_through_proxy
from tests.benchmarks.attack.connections import attack_with_connections, raise_own_limit
from tests.benchmarks.attack.freezing import attack_with_bodies, attack_with_reads
from tests.benchmarks.attack.memory import attack_memory
from tests.benchmarks.attack.rows import Row
from tests.benchmarks.attack.service import Service, run_service
from tests.benchmarks.attack.uploads import attack_readers

Shared = Callable[[Service, bool], list[Row]]
Alone = Callable[[Sequence[str], bool], list[Row]]

ENTRANCES: dict[int, Shared] = {5: attack_through_proxy, 1: attack_readers}
LOADS: dict[int, Shared] = {2: attack_with_bodies, 3: attack_with_reads, 15: attack_memory}
"""Attacks that share one service."""
SHORTAGES: dict[int, Alone] = {8: attack_with_connections}
"""Attacks on a service of their own each."""
ITEMS = tuple(sorted({**ENTRANCES, **LOADS, **SHORTAGES}))


def attack(command: Sequence[str], items: Sequence[int] = ITEMS, *, short: bool = False) -> list[Row]:
    """Attack a service that `command` starts; the rows by item.

    One attack after the other, so that times are those of a machine that does nothing else; in the short form three at
    a time, as most of them wait for something.
    """
    raise_own_limit()
    rows, begin = list[Row](), time.monotonic()
    lanes = [lambda: _attack_shared(command, ENTRANCES, items, short, rows, begin),
             lambda: _attack_shared(command, LOADS, items, short, rows, begin),
             lambda: _attack_alone(command, SHORTAGES, items, short, rows, begin)]  # fmt: skip
    threads = [threading.Thread(target=lane) for lane in lanes]
    for thread in threads:
        thread.start()
        if not short:
            thread.join()
    for thread in threads:
        thread.join()
    _report(f"{len(rows)} rows", begin)
    return sorted(rows, key=lambda row: (int(row.item.rstrip("abcdef")), row.item))


def _attack_shared(
    command: Sequence[str], attacks: dict[int, Shared], items: Sequence[int], short: bool, rows: list[Row], begin: float
) -> None:
    """Attacks that share one service; where that does not start, none of them has been held."""
    chosen = [item for item in attacks if item in items]
    if not chosen:
        return
    try:
        with run_service(command) as service:
            while chosen:
                item = chosen.pop(0)
                rows.extend(_try(item, begin, partial(attacks[item], service, short)))
    except Exception as error:  # those that are left are rows too
        rows.extend(_make_broken_row(item, error) for item in chosen)


def _attack_alone(
    command: Sequence[str], attacks: dict[int, Alone], items: Sequence[int], short: bool, rows: list[Row], begin: float
) -> None:
    for item in attacks:
        if item in items:
            rows.extend(_try(item, begin, partial(attacks[item], command, short)))


def _try(item: int, begin: float, run: Callable[[], list[Row]]) -> list[Row]:
    """The rows of an attack; one that breaks has not been held."""
    _report(f"item {item} begins", begin)
    try:
        rows = run()
    except Exception as error:  # whatever it is: the others are still to be tried
        rows = [_make_broken_row(item, error)]
    for row in rows:
        _report(f"{row.item} {row.verdict}: {row.figure}", begin)
    return rows


def _make_broken_row(item: int, error: Exception) -> Row:
    return Row(str(item), "the attack itself", f"broke: {type(error).__name__}: {error}"[:160], "-", False)


def _report(words: str, begin: float) -> None:
    print(f"[{time.monotonic() - begin:6.1f} s] {words}", file=sys.stderr, flush=True)
