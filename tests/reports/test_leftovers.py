"""Nothing English is left on screens of another language: every text that has a key comes out in capitals here."""

import io
import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import shapely
from rich.console import Console, RenderableType

from fields import Field
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.planning import plan
from planner.request.plan_request import PlanRequest
from reports.common import language as languages
from reports.common import text_tables
from reports.common.language import Reader, use_reader
from reports.common.plan_results import PlanRanking
from reports.day.tables import build_day_screen, build_day_table
from reports.plan.many_fields import build_many_fields_screen, build_many_fields_table
from reports.plan.ranking_table import build_first_screen, build_ranking_table
from tests.reports.brackets import Brackets
from tests.reports.screen_cases import RANKINGS, build_day, build_records

pytestmark = pytest.mark.usefixtures("first_layout")

NAMES = re.compile(
    r"--[a-z-]+|split-field|row-by-row(-optimised)?|interleaved|omega|switch-back(\+u)?|u\+switch-back|km/h|Yanmar|denmark|"
    r"small|field \d+|'?strip'?|farm\.geojson#strip|robots|Fendts|harrow|far\b|https?://\S+|plan\.\w+|fields\.html|"
    r"day\.html|[Ll]oam|cultivator|cone index: .*|FAO-56.*|, \w+ \d\.\w+"
)
"""What is the same in every language: options, strategies, units, names of fields and machines, sources of tables."""


class Capitals(Brackets):
    """A catalogue that puts every known text into capitals, but for the names of its values."""

    def gettext(self, text: str) -> str:
        return self._raise(text) if text in self.texts else text

    def list_messages(self) -> dict[str, str]:
        return {text: self._raise(text) for text in self.texts}

    @staticmethod
    def _raise(text: str) -> str:
        return "".join(part if part.startswith("{") else part.upper() for part in re.split(r"(\{\w*\})", text))


@pytest.fixture
def capitals(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """German with every text in capitals."""
    catalogue = Capitals()
    messages = catalogue.list_messages()
    languages._list_patterns.cache_clear()
    monkeypatch.setattr(languages, "load_catalogue", lambda language: catalogue)
    monkeypatch.setattr(languages, "get_messages", lambda language: messages)
    monkeypatch.setattr(text_tables, "LINE_COLUMNS", 600)
    yield
    languages._list_patterns.cache_clear()


def find_small_letters(build: Callable[..., RenderableType], *arguments: Any) -> list[str]:
    """The words of a screen that come from no catalogue and are no names."""
    stream = io.StringIO()
    with use_reader(Reader("de")):
        Console(file=stream, width=600, color_system=None).print(build(*arguments))
    return re.findall(r"[A-Za-z]*[a-z]{3,}[A-Za-z]*", NAMES.sub("", stream.getvalue()))


@pytest.mark.usefixtures("capitals")
def test_no_english_is_left_on_first_screens_and_tables() -> None:
    day, records = build_day(), build_records()
    screens: list[tuple[Callable[..., RenderableType], Any]] = [
        *((build_first_screen, ranking) for name, ranking in RANKINGS.items() if name != "refused"),
        (build_day_screen, day),
        (build_many_fields_screen, records[:2]),
        (build_many_fields_table, records[:2]),
    ]
    left = {build.__name__: find_small_letters(build, what) for build, what in screens}
    assert {name: words for name, words in left.items() if words} == {}
    assert set(find_small_letters(build_day_table, day)) <= {"besides", "fleet", "time", "has", "for", "the", "other"}


@pytest.fixture(scope="module")
def planned() -> PlanRanking:
    """A real plan with samples, deadline, rain, soil and an implement that is too heavy."""
    request = PlanRequest(
        field="small", tractors=(1,), strategies=("split-field",), samples=100, start_s="13:00", deadline_s="13:01",
        soil="loam", width_m=6.0, speed_mps=12 / 3.6, rain="14:30=20,15:00=50", rain_mm="0,12,5",
    )  # fmt: skip
    return plan(request, field=Field("small", shapely.box(0, 0, 50, 60)), executor=SerialExecutor()).ranking


@pytest.mark.usefixtures("capitals")
def test_no_english_is_left_of_a_real_plan(planned: PlanRanking) -> None:
    """As `headland plan --explain` prints it."""
    assert find_small_letters(build_first_screen, planned) == []
    assert find_small_letters(build_ranking_table, planned) == []
