"""A bar of what a command does: its stages, how far each is, and about how long the rest takes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task
from rich.table import Column
from rich.text import Text

from reports.common.language import Reader, get_language, get_units, translate, use_reader

PRIOR_S = 4.0  # the seconds that were expected count as much as that many seconds observed
REFRESHES_PER_S = 4
WIDE_COLUMNS = 80
MOST_NAMED = 2  # of what is at work, so that the line holds the bar as well


class StageBar:
    """What is done of several stages, whose seconds are expected beforehand, and the seconds that are left."""

    def __init__(self, words: str) -> None:
        with use_reader():
            self._reader = Reader(get_language(), get_units())  # other threads report and draw, and know no reader
            self.words = translate(words)
        self._title = words
        self.left_s: float | None = None
        self.share: float | None = None
        self.at_work: tuple[str, ...] = ()
        self._expected_s: dict[str, float] = {}
        self._begun_s = self._reported_s = time.monotonic()

    def expect(self, expected_s: Mapping[str, float]) -> None:
        """The stages in their order, with about the seconds of each; what came before does not count."""
        self._expected_s = dict(expected_s)
        self._begun_s = time.monotonic()

    def report(self, words: str, done: int, total: int, share: float | None = None) -> None:
        """So many of a total are done in a stage, by default the same share of its work; a total of 0 is unknown."""
        with use_reader(self._reader):
            self.words = translate(words)
            if total:
                self.words = translate("{words}: {done} of {total}", words=self.words, done=done, total=total)
        share = share if share is not None else done / total if total else 0.0
        before_s, self._reported_s = 0.0, time.monotonic()
        for stage, expected_s in self._expected_s.items():
            if stage == words:  # what was expected is corrected by how long the stages have taken so far
                done_s, all_s = before_s + share * expected_s, sum(self._expected_s.values())
                pace = (self._reported_s - self._begun_s + PRIOR_S) / (done_s + PRIOR_S)
                self.share, self.left_s = done_s / all_s if all_s else None, (all_s - done_s) * pace
                return
            before_s += expected_s
        self.share = share if total else None
        self.left_s = (self._reported_s - self._begun_s) * (1.0 - share) / share if share else None

    def count(self, done: int, total: int) -> None:
        """So many of a total are done in the stage that the bar was opened with."""
        self.report(self._title, done, total)

    def show_work(self, names: Sequence[str]) -> None:
        """Name what is at work now, such as fields; each once."""
        self.at_work = tuple(dict.fromkeys(names))

    def describe(self) -> str:
        """The words of the stage, with what is at work: ``Planning fields: 3 of 9 (north, south)``."""
        shown = (*self.at_work[:MOST_NAMED], *(["..."] if len(self.at_work) > MOST_NAMED else []))
        return f"{self.words} ({', '.join(shown)})" if shown else self.words

    def describe_left(self) -> str:
        """The time that is left, as words; nothing before it can be said."""
        if self.left_s is None:
            return ""
        left_s = max(0, round(self.left_s - (time.monotonic() - self._reported_s)))
        with use_reader(self._reader):
            time_left = f"{left_s // 60}:{left_s % 60:02d}"
            return translate("about {time_left} left", time_left=time_left) if left_s else translate("nearly done")


class _BarColumn(ProgressColumn):
    """A text of the bar, drawn several times a second: the time left counts down between reports."""

    def __init__(self, bar: StageBar, describe: Callable[[], str]) -> None:
        super().__init__(Column(no_wrap=True))
        self._bar, self._describe = bar, describe

    def render(self, task: Task) -> Text:
        """The text as it is now; keeps the length of the bar up to date as well."""
        task.total = None if self._bar.share is None else 1.0
        task.completed = self._bar.share or 0.0
        return Text(self._describe())


@contextmanager
def open_stage_bar(words: str) -> Iterator[StageBar]:
    """Draw a bar on a terminal while the body runs, and nothing elsewhere; `words` say what is done at first."""
    console, bar = Console(stderr=True), StageBar(words)
    columns = (
        _BarColumn(bar, bar.describe),
        BarColumn(bar_width=24 if console.width >= WIDE_COLUMNS else 10),
        _BarColumn(bar, bar.describe_left),
    )
    is_hidden = not console.is_terminal
    with Progress(
        *columns, console=console, transient=True, disable=is_hidden, refresh_per_second=REFRESHES_PER_S
    ) as lines:
        lines.add_task(words, total=None)
        yield bar
