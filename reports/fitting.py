"""Tables and sentences that fit the console: what has no room is left out with a word, and no figure is cut."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType
from rich.table import Table
from rich.text import Text

from reports.wording import NO_BREAK, bound

LINE = 100  # columns; longer lines are hard to read
_GAP = 1
_LEAST_WORDS = 8
MARKS = " +-"


@dataclass(frozen=True)
class Column:
    """A column: its heading, a shorter one for where that has no room, and when it goes.

    `words` marks text on the left that may be broken over lines after one of `marks`, unless it is `whole`; figures
    stay whole, on the right. Of the columns with `drop` above 0 the highest goes first when the console is too narrow;
    those with 0 stay.
    """

    heading: str
    short: str = ""
    words: bool = False
    drop: int = 0
    whole: bool = False
    marks: str = MARKS


@dataclass(frozen=True)
class FittedTable:
    """Rows of text that choose their columns when the width of the console is known.

    First all columns under their headings, then under their short ones, then fewer columns and a line that names the
    missing ones. Rows that do not fit even so are printed as a list, a heading and its value per line. `styles` has
    one entry per row, or is empty; `elsewhere` says where missing columns are to be seen.
    """

    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    styles: tuple[str, ...] = ()
    header: bool = True
    elsewhere: str = "a wider window or --json shows more"

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterable[RenderableType]:
        places, short = self._fitting(options.max_width)
        widths = self._widths(places, short, options.max_width)
        if widths is None:
            yield from self._list()
            return
        yield self._table(places, widths, short)
        if len(places) < len(self.columns):
            missing = ", ".join(c.heading for n, c in enumerate(self.columns) if n not in places)
            yield sentence(f"No room for: {missing}; {self.elsewhere}.", style="dim")

    def fits(self, width: int) -> bool:
        """Whether every column has room under its full heading."""
        return self._room(range(len(self.columns)), short=False) <= width

    def _fitting(self, width: int) -> tuple[list[int], bool]:
        """The columns that fit and whether their headings are the short ones."""
        places = list(range(len(self.columns)))
        if self.fits(width):
            return places, False
        for number in sorted(places, key=lambda n: self.columns[n].drop, reverse=True):
            if self._room(places, short=True) <= width or not self.columns[number].drop:
                break
            places.remove(number)
        return places, True

    def _room(self, places: Sequence[int], short: bool) -> int:
        return sum(self._least(n, short) for n in places) + _GAP * (len(places) - 1)

    def _least(self, number: int, short: bool) -> int:
        """The narrowest column that cuts no figure and no word."""
        column = self.columns[number]
        cells = [row[number] for row in self.rows]
        if column.words and not column.whole:
            pieces = [piece for cell in cells for piece in _pieces(cell, column.marks)]
            return max([*map(cell_len, pieces), _heading(column, short, self.header), min(_LEAST_WORDS, _most(cells))])
        return max(_most(cells), _heading(column, short, self.header))

    def _widths(self, places: Sequence[int], short: bool, width: int) -> list[int] | None:
        """A width per column, None when nothing fits: headings get one line if all can, words what figures leave."""
        widths = [self._least(n, short) for n in places]
        spare = width - sum(widths) - _GAP * (len(places) - 1)
        if spare < 0:
            return None
        wanted = [
            max(_most([row[n] for row in self.rows]), cell_len(self.columns[n].heading) * self.header) - least
            for n, least in zip(places, widths, strict=True)
        ]
        if sum(wanted) > spare:
            wanted = [want * self.columns[n].words for n, want in zip(places, wanted, strict=True)]
        asked = sum(wanted)
        return [w + (want if asked <= spare else want * spare // asked) for w, want in zip(widths, wanted, strict=True)]

    def _table(self, places: Sequence[int], widths: Sequence[int], short: bool) -> Table:
        table = frame(self.header)
        for number, width in zip(places, widths, strict=True):
            column = self.columns[number]
            full = _heading(column, False, self.header) <= width
            heading = column.short if short and column.short and not full else column.heading
            lines = [line for part in heading.split("\n") for line in broken(part, width)]
            justify = "left" if column.words else "right"
            table.add_column(Text("\n".join(lines)), justify=justify, width=width, overflow="fold")  # type: ignore[arg-type]
        for index, row in enumerate(self.rows):
            cells = [
                "\n".join(line for part in row[n].split("\n") for line in broken(part, width, self.columns[n].marks))
                for n, width in zip(places, widths, strict=True)
            ]
            table.add_row(*map(Text, cells), style=self.styles[index] if self.styles else "")
        return table

    def _list(self) -> Iterable[RenderableType]:
        for row in self.rows:
            for number, (column, cell) in enumerate(zip(self.columns, row, strict=True)):
                head = f"{column.heading}: " if column.heading and self.header else ""
                text = (head + cell).replace("\n", " ").strip()
                yield sentence(text, indent=0 if not number else 2)


@dataclass(frozen=True)
class Sentence:
    """Words at most `LINE` columns wide that part no value from the word before it."""

    text: str
    style: str = ""
    indent: int = 0

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterable[RenderableType]:
        room = max(min(options.max_width, LINE) - self.indent, 1)
        for line in wrapped(self.text, room):
            yield Text(" " * self.indent + line, style=self.style, overflow="fold")


def sentence(text: str, style: str = "", indent: int = 0) -> Sentence:
    """A sentence for the console."""
    return Sentence(text, style, indent)


def wrapped(text: str, width: int) -> list[str]:
    """Lines of at most `width` columns; a value stays with the word before it where both have room."""
    lines = [""]
    for word in bound(text).split(" "):
        for piece in [word] if cell_len(word) <= width else word.split(NO_BREAK):
            joined = f"{lines[-1]} {piece}" if lines[-1] else piece
            if cell_len(joined) <= width or not lines[-1]:
                lines[-1] = joined
            else:
                lines.append(piece)
    return [line.replace(NO_BREAK, " ") for line in lines]


def broken(text: str, width: int, marks: str = MARKS) -> list[str]:
    """Lines of at most `width` columns, broken after the first of `marks` that helps; longer if none does."""
    if cell_len(text) <= width or not marks:
        return [text]
    lines = [""]
    for piece in re.findall(f"[^{re.escape(marks[0])}]*{re.escape(marks[0])}|.+$", text):
        if cell_len((lines[-1] + piece).rstrip()) <= width:
            lines[-1] += piece
        else:
            bare = piece.rstrip()
            lines += broken(bare, width, marks[1:])
            lines[-1] += piece[len(bare) :]
    return [line.rstrip() for line in lines if line]


def frame(header: bool = True) -> Table:
    """A table without lines."""
    return Table(box=None, show_header=header, header_style="bold", padding=(0, _GAP, 0, 0), pad_edge=False)


def _pieces(text: str, marks: str) -> list[str]:
    """What no line of a text is shorter than: the ends of pieces are spaces, and marks that stay with them."""
    known, kept = re.escape(marks + " "), re.escape(marks.replace(" ", ""))
    return re.findall(rf"[^{known}]+[{kept}]?" if kept else rf"[^{known}]+", text)


def _most(cells: Sequence[str]) -> int:
    return max((cell_len(line) for cell in cells for line in cell.split("\n")), default=0)


def _heading(column: Column, short: bool, shown: bool) -> int:
    """Columns a heading needs: it may be broken at spaces, a short one at its line ends too."""
    if not shown:
        return 0
    text = column.short if short and column.short else column.heading
    return max((cell_len(word) for word in re.split(r"\s", text)), default=0)
