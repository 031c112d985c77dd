"""Strategies of other packages: the one of the guide runs, and broken ones are refused only where they are named."""

import importlib
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from fields.geometry.field import Field
from planner.errors import RequestError
from planner.evaluation.time_share import TimeShare, TimeSpentError
from planner.evaluation.work_order import WorkOrder
from planner.guide.guide_pages import read_page
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.many_fields import hash_order
from planner.pipeline.planning import plan
from planner.request.plan_request import PlanRequest
from strategies import registry
from strategies.names import STRATEGY_NAMES, list_entry_points, list_strategy_names
from strategies.path_planning.errors import StrategyError
from strategies.registry import STRATEGIES, describe_hidden_strategies, get_strategy
from vehicle.missions.plan import HEADLAND_PASS, SWATH, LegTask

pytestmark = pytest.mark.usefixtures("first_layout")

ROOT = Path(__file__).parents[2]
FACE = ROOT / "planner/cli/alias"
FIELD = Field("box", shapely.box(0.0, 0.0, 60.0, 90.0))
Install = Callable[..., Path]


@dataclass(frozen=True)
class Line:
    """A work line as a deal sees it."""

    task: LegTask
    length_m: float = 80.0


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Put a package with one module and entry points on the path, as an installer would."""
    monkeypatch.syspath_prepend(str(FACE))
    registry._load_strategy.cache_clear()

    def write(module: str, source: str, entries: dict[str, str], package: str = "") -> Path:
        folder = tmp_path / f"{package or module}-1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package or module}\nVersion: 1.0\n")
        lines = "".join(f"{name} = {value}\n" for name, value in entries.items())
        (folder / "entry_points.txt").write_text(f"[headland.strategies]\n{lines}")
        (tmp_path / f"{module}.py").write_text(source, encoding="utf-8")
        monkeypatch.syspath_prepend(str(tmp_path))
        list_entry_points.cache_clear()
        monkeypatch.delitem(sys.modules, module, raising=False)
        return tmp_path

    yield write
    list_entry_points.cache_clear()


@pytest.fixture
def blocks(install: Install) -> Path:
    """The example of the guide, with the name and entry points of its pyproject.toml."""
    text = read_page("strategies").text
    (source,) = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    (toml,) = re.findall(r"```toml\n(.*?)```", text, flags=re.DOTALL)
    project = tomllib.loads(toml)["project"]
    assert len(source.splitlines()) <= 35
    return install("headland_blocks", source, project["entry-points"]["headland.strategies"], project["name"])


def test_the_example_of_the_guide_plans(blocks: Path) -> None:
    assert list_strategy_names() == (*STRATEGY_NAMES, "blocks")
    assert "blocks" not in PlanRequest().strategies
    request = PlanRequest(strategies=("blocks",), tractors=(1, 2), width_m=6.0, local=True)
    answer = plan(request, field=FIELD, executor=SerialExecutor())
    assert [one.strategy for one in answer.ranking.plans if one.feasible] == ["blocks", "blocks"]
    name = answer.run.plan.notes.strategy
    assert name == "blocks" and answer.ranking.best.worked_pct > 90.0


@pytest.mark.slow
def test_other_processes_load_it_as_well(blocks: Path) -> None:
    request = PlanRequest(strategies=("blocks",), tractors=(2,), width_m=6.0, local=True)
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        elsewhere = plan(request, field=FIELD, executor=pool).ranking.plans[0]
    assert elsewhere.feasible and elsewhere == plan(request, field=FIELD, executor=SerialExecutor()).ranking.plans[0]


def test_the_blocks_of_the_example_are_neighbours(blocks: Path, driving_rules: Any) -> None:
    lines = [Line(LegTask(SWATH, number)) for number in range(6)] + [Line(LegTask(HEADLAND_PASS, 1))]
    deal = get_strategy("blocks").deal
    assert deal is not None
    allowed = deal(lines, driving_rules, 3).allowed
    assert allowed[:, :6].tolist() == np.repeat(np.eye(3, dtype=bool), 2, axis=1).tolist() and allowed[:, 6].all()


def test_an_answer_depends_on_the_source_of_the_strategy(blocks: Path) -> None:
    question = WorkOrder(PlanRequest(strategies=("blocks",)))
    before, own = hash_order(question), hash_order(WorkOrder(PlanRequest()))
    (blocks / "headland_blocks.py").write_text("# changed")
    assert hash_order(question) != before
    assert hash_order(WorkOrder(PlanRequest())) == own


def test_a_package_without_a_module_of_its_own_has_sources_too(install: Install) -> None:
    folder = install("loosely", "", {"loose": "loose.rule:STRATEGY"}) / "loose"
    folder.mkdir()
    (folder / "rule.py").write_text("STRATEGY = None")
    importlib.invalidate_caches()
    assert registry.list_source_files(["loose"]) == [folder / "rule.py"]


@pytest.mark.parametrize(
    ("name", "source", "words"),
    [
        ("missing", "import nowhere_at_all", r"of the package broken cannot be loaded \(ModuleNotFoundError: .*repair"),
        (
            "wordless",
            "STRATEGY = {}",
            r"of the package broken cannot be loaded \(TypeError: broken_wordless:STRATEGY is no headland.Strategy of",
        ),
        (
            "misnamed",
            "from headland import Strategy\nSTRATEGY = Strategy('other', 'words', lambda *_: None)",
            "broken_misnamed:STRATEGY is no headland.Strategy of that name",
        ),
    ],
)
def test_a_broken_one_is_refused_where_it_is_named(install: Install, name: str, source: str, words: str) -> None:
    install(f"broken_{name}", source, {name: f"broken_{name}:STRATEGY"}, "broken")
    with pytest.raises(RequestError, match=words) as refusal:
        PlanRequest(strategies=("split-field", name))
    assert refusal.value.parameter == "strategies" and "\n" not in str(refusal.value)
    assert PlanRequest(strategies=("split-field",)).strategies == ("split-field",)


def test_faults_while_planning_are_a_reason_and_leave_other_plans(install: Install) -> None:
    source = "from headland import Strategy\nSTRATEGY = Strategy('faulty', 'words', lambda *_: 1 // 0)"
    install("faulty_one", source, {"faulty": "faulty_one:STRATEGY"})
    request = PlanRequest(strategies=("faulty", "split-field"), tractors=(1,), width_m=6.0, local=True)
    ranking = plan(request, field=FIELD, executor=SerialExecutor()).ranking
    assert ranking.best.strategy == "split-field"
    assert ranking.plans[-1].reason is not None
    assert "Strategy 'faulty' of the package faulty_one failed (ZeroDivisionError" in ranking.plans[-1].reason


def test_the_end_of_the_computing_time_is_no_fault_of_a_strategy(install: Install) -> None:
    source = "from headland import Strategy\nSTRATEGY = Strategy('slow', 'words', lambda check, *_: check())"
    install("slow_one", source, {"slow": "slow_one:STRATEGY"})
    with pytest.raises(TimeSpentError):
        get_strategy("slow").deal(TimeShare(-1.0).check, None, 1)  # type: ignore[arg-type,misc]


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("None", "TypeError: it gives a NoneType in place of a LineDeal"),
        ("LineDeal(free_other_lines(lines, 1))", r"ValueError: allowed has the shape \(1, 2\) in place of \(2, 2\)"),
        (
            "LineDeal(free_other_lines(lines, 2), places=[0])",
            "ValueError: places are 1 in place of 2, one for each line",
        ),
    ],
)
def test_what_is_no_deal_is_a_reason(install: Install, driving_rules: Any, body: str, words: str) -> None:
    source = f"from headland import *\nSTRATEGY = Strategy('odd', 'words', lambda lines, *_: {body})"
    install("odd_one", source, {"odd": "odd_one:STRATEGY"})
    with pytest.raises(StrategyError, match=f"Strategy 'odd' of the package odd_one failed .{words}"):
        get_strategy("odd").deal([Line(LegTask(SWATH, 1))] * 2, driving_rules, 2)  # type: ignore[misc]


def test_a_name_of_headland_stays_headlands_and_a_remark_says_so(install: Install) -> None:
    install("rival", "raise RuntimeError", {"split-field": "rival:STRATEGY"})
    assert get_strategy("split-field") is STRATEGIES["split-field"]
    assert describe_hidden_strategies() == [
        "Strategy 'split-field' of the package rival is left out, as Headland has one of that name; rename it there."
    ]


def test_two_packages_with_one_name_are_refused_where_it_is_named(install: Install) -> None:
    install("first_one", "", {"twice": "first_one:STRATEGY"})
    install("second_one", "", {"twice": "second_one:STRATEGY"})
    with pytest.raises(RequestError, match="Strategy 'twice' is in first_one and second_one; uninstall one"):
        PlanRequest(strategies=("twice",))


@pytest.mark.slow
def test_the_command_line_names_it_among_the_known(blocks: Path) -> None:
    code = "from planner.cli.main import main; main()"
    environment = os.environ | {"PYTHONPATH": f"{blocks}:{ROOT}:{FACE}", "COLUMNS": "200"}

    def run(*words: str) -> subprocess.CompletedProcess[str]:
        command, how = [sys.executable, "-c", code, *words], {"capture_output": True, "text": True, "check": False}
        return subprocess.run(command, cwd=blocks, env=environment, **how)  # type: ignore[call-overload,no-any-return]

    refused = run("plan", "denmark", "--strategies", "block")
    assert refused.returncode == 2
    assert "'block' is unknown (did you mean 'blocks'?); use one of: row-by-row," in refused.stderr
