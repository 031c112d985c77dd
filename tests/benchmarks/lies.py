"""What is noticed of a robot that lies in each field of its states, alone and in pairs, and after how long.

python -m tests.benchmarks.lies            # the table of the threat model
python -m tests.benchmarks.lies --pairs    # all pairs of fields: minutes
"""

import itertools
import sys
from collections.abc import Callable, Sequence
from functools import cache

from tests.service.liars import FIELDS, HIDDEN, Scene, lose_operator, meet, stop

SCENES: dict[str, Callable[..., tuple[Scene, float]]] = {
    "stop_all": lambda lies: (stop(lies), 0.0),
    "dead-man": lambda lies: (lose_operator(lies), 0.0),
    "another fleet": meet,
}
ROWS: list[tuple[str, ...]] = [(), *((name,) for name in (*FIELDS, *HIDDEN))]


@cache
def watch(scene: str, names: tuple[str, ...]) -> tuple[dict[str, float], float]:
    """The seconds from the lie to each alarm, and the metres between the antennas as the other fleet stands."""
    seen, apart_m = SCENES[scene]([lie for name in names for lie in HIDDEN.get(name) or [FIELDS[name]]])
    return seen.seen, apart_m


def format_cell(scene: str, names: tuple[str, ...]) -> str:
    """First alarm and first critical one with their seconds, and the distance kept to another fleet."""
    seen, apart_m = watch(scene, names)
    shown = sorted(seen.items(), key=lambda item: item[1])
    first_critical = next((item for item in shown if is_critical(item[0])), None)
    told = {code.removesuffix(" (warning)"): seconds for code, seconds in [*shown[:1], *filter(None, [first_critical])]}
    text = ", ".join(f"{code} {seconds:.1f} s" for code, seconds in told.items())
    return (text or "nothing") + (f"; {apart_m:.1f} m" if scene == "another fleet" else "")


def is_critical(code: str) -> bool:
    return not code.endswith("(warning)")


def format_table(rows: Sequence[tuple[str, ...]]) -> str:
    """The table of the guide, a row for each lie."""
    lines = ["| lies in | " + " | ".join(SCENES) + " |", "|---" * (1 + len(SCENES)) + "|"]
    for names in rows:
        title = " and ".join(name if name in HIDDEN else f"`{name}`" for name in names) or "nothing"
        lines.append("| " + " | ".join([title, *(format_cell(scene, names) for scene in SCENES)]) + " |")
    return "\n".join(lines)


def main() -> None:
    rows = ROWS
    if "--pairs" in sys.argv:
        rows = list(itertools.combinations(FIELDS, 2))
    for row in rows:
        print(format_table([row]).splitlines()[-1], flush=True)


if __name__ == "__main__":
    main()
