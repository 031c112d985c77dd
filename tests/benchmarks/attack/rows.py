"""What an attack came to: one row each, as a table of at most 100 columns or as JSON."""

import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

HEAD = ("item", "attacked", "figure", "limit", "verdict")
WIDTHS = (4, 30, 32, 21, 8)  # with a blank between two columns, 99
HEAD_OF_TWO = ("item", "attacked", "before", "now", "limit", "verdict")
WIDTHS_OF_TWO = (4, 20, 24, 24, 15, 8)  # 100
HELD, NOT_HELD, SKIPPED = "held", "NOT HELD", "skipped"


@dataclass(frozen=True)
class Row:
    """One attack: what was attacked, the figure in words, the limit, and whether it held (None where not tried).

    `values` are the figures as numbers, for whoever compares two runs.
    """

    item: str
    attacked: str
    figure: str
    limit: str
    held: bool | None
    values: dict[str, Any] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """The verdict in a word."""
        if self.held is None:
            return SKIPPED
        return HELD if self.held else NOT_HELD


def list_rows(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """The rows as JSON has them."""
    return [asdict(row) | {"verdict": row.verdict} for row in rows]


def format_table(rows: Iterable[Row], before: Iterable[dict[str, Any]] = ()) -> str:
    """The rows as a table of at most 100 columns; with the figures of an earlier run (`list_rows`) beside them."""
    earlier = {str(one["item"]): str(one["figure"]) for one in before}
    head, widths = (HEAD_OF_TWO, WIDTHS_OF_TWO) if earlier else (HEAD, WIDTHS)
    lines = [*_wrap_cells(head, widths), " ".join("-" * width for width in widths)]
    for row in rows:
        figures = (earlier.get(row.item, "-"), row.figure) if earlier else (row.figure,)
        lines += _wrap_cells((row.item, row.attacked, *figures, row.limit, row.verdict), widths)
    return "\n".join(lines)


def _wrap_cells(cells: Sequence[str], widths: Sequence[int]) -> list[str]:
    """The lines of one row."""
    columns = [textwrap.wrap(cell, width) or [""] for cell, width in zip(cells, widths, strict=True)]
    high = max(map(len, columns))
    columns = [column + [""] * (high - len(column)) for column in columns]
    return [" ".join(f"{cell:{width}}" for cell, width in zip(line, widths, strict=True)).rstrip()
            for line in zip(*columns, strict=True)]  # fmt: skip
