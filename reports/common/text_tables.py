"""Tables and sentences that fit the console: columns without room are named, and no figure is cut."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from fields.errors import escape_controls
from reports.common.language import mark_text, translate, translate_count, translate_sentence
from reports.common.rendering import render_template
from reports.common.wording import NO_BREAK, insert_non_breaking_spaces

MOST_NAMED = 3  # runs, fields or tractors in a sentence of a screen; how many more there are is counted
LINE_COLUMNS = 100  # columns; longer lines are hard to read
LEAST_ANSWER_COLUMNS = 80  # from here on an answer keeps to its lines
MOST_ANSWER_LINES, MOST_NARROW_LINES = 8, 16
Item = TypeVar("Item")
_GAP_COLUMNS = 1
_LEAST_TEXT_COLUMNS = 8
BREAK_MARKS = " +-"
_WIDE = "\u3041-\u30ff\u3400-\u9fff"  # Japanese letters
_WIDE_OR_OTHERS = re.compile(
    f"[{_WIDE}][\u3001\u3002\u300d\uff09\u3063\u3083\u3085\u3087\u30c3\u30e3\u30e5\u30e7\u30fc]*|[^{_WIDE}]+"
)


@dataclass(frozen=True)
class TableColumn:
    """A column: its heading, a shorter heading for narrow consoles, and when it is dropped.

    Text (`is_text`) is aligned left and may be broken over lines after one of `break_marks`, unless it is
    `is_unbroken`; figures are aligned right and never broken. When the console is too narrow, the column with the
    highest `drop_order` is dropped first; those with 0 always stay.
    """

    heading: str
    short_heading: str = ""
    is_text: bool = False
    drop_order: int = 0
    is_unbroken: bool = False
    break_marks: str = BREAK_MARKS

    @property
    def full_title(self) -> str:
        """The heading in the language in use."""
        return translate_sentence(self.heading)

    @property
    def short_title(self) -> str:
        """The short heading in the language in use, "" where there is none."""
        return translate_sentence(self.short_heading)


@dataclass(frozen=True)
class FittedTable:
    """Rows of text whose columns are chosen when the width of the console is known.

    All columns under their headings, else under their short headings, else fewer columns and a line that names the
    missing ones, else a list with a heading and its value per line. `styles` has one entry per row, or is empty;
    `more_hint` says where missing columns can be seen. Control characters, such as a line break in a name, are shown
    as `\\n`; only with `has_lines` can a cell have several lines. `notes` are said below it: what its marks and columns
    mean, and what it leaves out.
    """

    columns: tuple[TableColumn, ...]
    rows: tuple[tuple[str, ...], ...]
    styles: tuple[str, ...] = ()
    more_hint: str = mark_text("a wider window or --json shows more")
    has_lines: bool = False
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.has_lines:
            object.__setattr__(self, "rows", tuple(tuple(map(escape_controls, row)) for row in self.rows))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterable[RenderableType]:
        places, short, least_widths = self._choose_columns(options.max_width)
        spare = options.max_width - sum(least_widths) - _GAP_COLUMNS * (len(places) - 1)
        notes = list(self.notes)
        if spare < 0:
            for row in self.rows:
                for number, (column, cell) in enumerate(zip(self.columns, row, strict=True)):
                    head = f"{column.full_title}: " if column.heading else ""
                    text = (head + cell).replace("\n", " ").strip()
                    yield format_sentence(text, indent=2 if number else 0)
        else:
            yield self._build_rich_table(places, self._widen_columns(places, least_widths, spare), short)
            if len(places) < len(self.columns):
                missing = ", ".join(c.full_title for n, c in enumerate(self.columns) if n not in places)
                hint = translate(self.more_hint)
                notes.insert(0, translate("No room for: {columns}; {hint}.", columns=missing, hint=hint))
        yield from (format_sentence(note, style="dim") for note in notes)

    def _choose_columns(self, width: int) -> tuple[list[int], bool, list[int]]:
        """The columns that fit, else the fewest; whether their headings are the short ones; and their least widths."""
        orders = [column.drop_order for column in self.columns]
        by_order = sorted((n for n, order in enumerate(orders) if order), key=orders.__getitem__, reverse=True)
        for count, short in ((0, False), *((count, True) for count in range(len(by_order) + 1))):
            places = [n for n in range(len(orders)) if n not in by_order[:count]]
            widths = [self._compute_least_column_width(n, short) for n in places]
            if sum(widths) + _GAP_COLUMNS * (len(places) - 1) <= width:
                break
        return places, short, widths

    def _compute_least_column_width(self, number: int, short: bool) -> int:
        """The narrowest column that cuts no figure and no word."""
        column = self.columns[number]
        cells = [row[number] for row in self.rows]
        if column.is_text and not column.is_unbroken:
            # Pieces that cannot be broken further: a mark other than a space stays with its piece.
            marks = column.break_marks
            separators, trailing_marks = re.escape(marks + " "), re.escape(marks.replace(" ", ""))
            pattern = f"[^{separators}]+[{trailing_marks}]?" if trailing_marks else f"[^{separators}]+"
            pieces = [piece for cell in cells for piece in re.findall(pattern, cell)]
            return max(
                [
                    *map(cell_len, pieces),
                    _measure_heading(column, short),
                    min(_LEAST_TEXT_COLUMNS, _measure_widest(cells)),
                ]
            )
        return max(_measure_widest(cells), _measure_heading(column, short))

    def _widen_columns(self, places: Sequence[int], widths: Sequence[int], spare: int) -> list[int]:
        """The widths with room to spare shared out: text gets what figures do not need."""
        extra_widths = [
            max(_measure_widest([row[n] for row in self.rows]), cell_len(self.columns[n].full_title)) - least
            for n, least in zip(places, widths, strict=True)
        ]
        if sum(extra_widths) > spare:
            extra_widths = [want * self.columns[n].is_text for n, want in zip(places, extra_widths, strict=True)]
        total_extra = sum(extra_widths)
        return [
            w + (want if total_extra <= spare else want * spare // total_extra)
            for w, want in zip(widths, extra_widths, strict=True)
        ]

    def _build_rich_table(self, places: Sequence[int], widths: Sequence[int], short: bool) -> Table:
        gaps = (0, _GAP_COLUMNS, 0, 0)
        has_header = any(column.heading for column in self.columns)
        table = Table(box=None, show_header=has_header, header_style="bold", padding=gaps, pad_edge=False)
        for number, width in zip(places, widths, strict=True):
            column = self.columns[number]
            full = _measure_heading(column, False) <= width
            heading = column.short_title if short and column.short_title and not full else column.full_title
            lines = [line for part in heading.split("\n") for line in break_text_at_marks(part, width)]
            justify = "left" if column.is_text else "right"
            table.add_column(Text("\n".join(lines)), justify=justify, width=width, overflow="fold")  # type: ignore[arg-type]
        for index, row in enumerate(self.rows):
            cells = [
                "\n".join(
                    line
                    for part in row[n].split("\n")
                    for line in break_text_at_marks(part, width, self.columns[n].break_marks)
                )
                for n, width in zip(places, widths, strict=True)
            ]
            table.add_row(*map(Text, cells), style=self.styles[index] if self.styles else "")
        return table


def build_table(
    items: Iterable[Item],
    figures: Sequence[tuple[TableColumn, Callable[[Item], str]]],
    is_marked: Callable[[Item], bool] = lambda item: False,
    **look: Any,
) -> FittedTable:
    """A row per item, marked ones in bold; figures are columns with what writes their cells. `look` as FittedTable."""
    rows = [(tuple(write(item) for _, write in figures), "bold" if is_marked(item) else "") for item in items]
    cells, styles = (tuple(row[place] for row in rows) for place in (0, 1))
    return FittedTable(tuple(column for column, _ in figures), cells, styles, **look)  # type: ignore[arg-type]


def build_plain_table(
    headings: Sequence[str], rows: Iterable[tuple[str, ...]], texts: Sequence[int] = (0,), **look: Any
) -> FittedTable:
    """Rows of cells under plain headings; columns at the places `texts` hold text. `look` as FittedTable.

    Headings that are written in the call are texts of the catalogues.
    """
    columns = tuple(TableColumn(heading, is_text=place in texts) for place, heading in enumerate(headings))
    return FittedTable(columns, tuple(rows), **look)


def render_fragment(
    title: str, sentences: Sequence[str], tables: Sequence[FittedTable], picture: str | None = None, alt: str = ""
) -> str:
    """A result as HTML for a notebook, everything escaped; `picture` is a PNG in base64, `alt` what it shows."""
    content: dict[str, Any] = {
        "title": title, "sentences": sentences, "tables": tables, "picture": picture, "alt": alt
    }  # fmt: skip
    return render_template("notebook.html.j2", content)


@dataclass(frozen=True)
class WrappedSentence:
    """Text in lines of at most `LINE_COLUMNS` columns; a value stays with the word before it."""

    text: str
    style: str = ""
    indent: int = 0

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterable[RenderableType]:
        room = max(min(options.max_width, LINE_COLUMNS) - self.indent, 1)
        for line in wrap_text(escape_controls(translate_sentence(self.text)), room):
            yield Text(" " * self.indent + line, style=self.style, overflow="fold")


@dataclass(frozen=True)
class AnswerLines:
    """An answer before its table, in at most eight lines below its title where the console has 80 columns.

    The title and `sentences` always stand there whole, the first of these in bold. Where lines are lacking, as many of
    the remarks (`faults`) as have no room are counted instead, the last first, and then `alternatives` go, the last
    first. One that `is_whole` has as many lines as it takes.
    """

    sentences: tuple[str, ...]
    alternatives: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    title: str = ""
    is_whole: bool = False

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterable[RenderableType]:
        width = min(options.max_width, LINE_COLUMNS)
        most = MOST_ANSWER_LINES if options.max_width >= LEAST_ANSWER_COLUMNS else MOST_NARROW_LINES
        most = sys.maxsize if self.is_whole else most
        sentences = self.sentences
        room, count, notes = most - count_lines(sentences, width), len(self.faults), [" ".join(self.faults)]
        for more in range(1, count):
            remark = " ".join(self.faults[: count - more])
            notes.append(translate("{remark} {count} more: --explain.", remark=remark, count=more))
        if count:
            notes.append(translate_count("{count} remark: --explain.", "{count} remarks: --explain.", count))
        first_ones = [self.alternatives[:count] for count in range(len(self.alternatives), -1, -1)]
        choices = [(alternatives, note) for alternatives in first_ones for note in notes]
        alternatives, note = next(
            ((some, note) for some, note in choices if count_lines([*some, note], width) <= room),
            ((), notes[-1]),
        )
        if self.title:
            yield format_title(self.title)
        for place, text in enumerate(filter(None, (*sentences, *alternatives))):
            yield format_sentence(text, style="" if place else "bold")
        if note:
            yield format_sentence(note, style="yellow")


def count_lines(sentences: Iterable[str], width: int) -> int:
    """How many lines of at most `width` columns sentences take."""
    return sum(len(wrap_text(escape_controls(text), width)) for text in sentences if text)


def format_title(text: str, style: str = "bold underline") -> Text:
    """A heading of a table, in one line."""
    return Text(escape_controls(translate_sentence(text)), style=style)


def format_sentence(text: str, style: str = "", indent: int = 0) -> WrappedSentence:
    """A sentence for the console."""
    return WrappedSentence(text, style, indent)


def format_bullet(text: str) -> RenderableType:
    """A sentence of a list, behind a dash."""
    grid = Table.grid(padding=(0, 1, 0, 0))
    grid.add_column(width=1)
    grid.add_column(overflow="fold")
    grid.add_row(Text("-"), Padding(format_sentence(text), 0))
    return grid


def wrap_text(text: str, width: int) -> list[str]:
    """Lines of at most `width` columns; a value stays with the word before it if both fit in a line.

    Japanese has no spaces and is broken between any two letters, but not before a mark that ends something.
    """
    lines = [""]
    for space, piece in _list_pieces(insert_non_breaking_spaces(text), width):
        joined = f"{lines[-1]}{space}{piece}" if lines[-1] else piece
        if cell_len(joined) <= width or not lines[-1]:
            lines[-1] = joined
        else:
            lines.append(piece)
    return [line.replace(NO_BREAK, " ") for line in lines]


def _list_pieces(text: str, width: int) -> Iterable[tuple[str, str]]:
    """What is not broken over lines, each with the space before it."""
    for word in text.split(" "):
        for part in [word] if cell_len(word) <= width else word.split(NO_BREAK):
            for number, piece in enumerate(_WIDE_OR_OTHERS.findall(part) or [""]):
                yield "" if number else " ", piece


def break_text_at_marks(text: str, width: int, marks: str = BREAK_MARKS) -> list[str]:
    """Lines of at most `width` columns, broken after the first of `marks` that is enough; longer if none is."""
    if cell_len(text) <= width or not marks:
        return [text]
    lines = [""]
    for piece in re.findall(f"[^{re.escape(marks[0])}]*{re.escape(marks[0])}|.+$", text):
        if cell_len((lines[-1] + piece).rstrip()) <= width:
            lines[-1] += piece
        else:
            bare = piece.rstrip()
            lines += break_text_at_marks(bare, width, marks[1:])
            lines[-1] += piece[len(bare) :]
    return [line.rstrip() for line in lines if line]


def _measure_widest(cells: Sequence[str]) -> int:
    return max((cell_len(line) for cell in cells for line in cell.split("\n")), default=0)


def _measure_heading(column: TableColumn, short: bool) -> int:
    """Columns a heading needs: it may be broken at spaces, a short one at its line ends too."""
    text = column.short_title if short and column.short_title else column.full_title
    return max((cell_len(word) for word in re.split(r"\s", text)), default=0)
