"""Collects sentences that the code makes with f-strings: refusals, remarks and reasons, as keys with named values.

They are in English where they are made, and translated where they are shown (`translate_sentence`).
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from tests.test_structure import ROOT

REFUSING_PACKAGES = (
    "fields", "planner/cli", "planner/request", "planner/farm", "planner/day", "planner/pipeline", "vehicle/model",
)  # fmt: skip
"""Where refusals come from that users of the command line and of the page meet most."""
TELLING_MODULES = (
    "fields/documents/reader.py", "fields/geometry/assumed_obstacles.py", "fields/geometry/chosen_places.py",
    "fields/geometry/field.py", "fields/geometry/field_lines.py", "fields/geometry/obstacles.py",
    "fields/layout/swaths.py", "fields/nested_text.py",
    "planner/day/planning.py", "planner/day/field_times.py", "planner/evaluation/candidates/evaluate.py",
    "planner/evaluation/candidates/figures.py",
    "strategies/formations/compose.py", "strategies/path_planning/errors.py",
    "planner/evaluation/candidates/fleet_drive.py", "strategies/registry.py",
    "planner/evaluation/candidates/slope_figures.py",
    "planner/evaluation/field_physics.py", "planner/evaluation/ground_sentences.py",
    "planner/evaluation/preparation.py", "fields/terrain/checks.py",
    "planner/pipeline/ranking.py", "planner/pipeline/many_fields.py",
    "planner/risk/assessment.py",
    "reports/common/plan_results.py", "reports/day/tables.py",
    "reports/plan/ranking_table.py", "reports/plan/field_report.py", "reports/plan/many_fields.py",
    "planner/cli/plan.py", "planner/request/option_texts.py",
)  # fmt: skip
"""Modules that make remarks, reasons and other sentences."""
ALARMING_MODULES = (
    "planner/fleet/manager/danger_watch.py", "planner/fleet/manager/fleet_manager.py",
    "planner/fleet/manager/operator_orders.py",
    "planner/fleet/manager/obstacle_reports.py", "planner/fleet/session/fleet_twins.py",
    "planner/fleet/manager/remaining_work.py",
    "planner/fleet/replanning/from_here.py",
    "planner/fleet/replanning/planning_anew.py", "planner/fleet/replanning/proposals.py",
    "planner/fleet/safety/compliance.py",
    "planner/service/fleets/twin_routes.py",
    "planner/service/jobs/job_runs.py", "planner/service/jobs/workers.py", "planner/service/sandbox/readings.py",
    "planner/service/fleets/fleet_socket.py", "fields/formats/features.py",
    "fields/documents/sources.py", "planner/request/options.py", "planner/request/validation.py",
    "strategies/rules/dealing.py", "strategies/lines/line_wishes.py",
    "planner/evaluation/candidates/line_programme.py", "planner/evaluation/layout_choice.py",
    "vehicle/identification/logs/table.py", "reports/plan/plan_wording.py", "reports/plan/shortfall_wording.py",
    "planner/risk/costs.py", "vehicle/energy/trafficability.py",
    "planner/evaluation/ground/unworked_area.py", "fields/geometry/outline_cleaning.py", "planner/pipeline/going_on.py",
)  # fmt: skip
"""Modules of which every sentence is told: alarms, twins, jobs and forms of the service, checks of values."""
_TELLING_NAME = re.compile(
    r"describe|remark|explain|reason|warn|question|_list_|suggest|advi[cs]e|summar|build_.*table|print"
)
LEAST_WORDS, LEAST_LETTERS = 3, 12


def iter_sentences() -> Iterator[str]:
    """Keys of all refusals, remarks and reasons."""
    for package in REFUSING_PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            yield from _iter_refusals(path)
    for name in TELLING_MODULES:
        if (ROOT / name).exists():
            yield from _iter_told(ROOT / name)
    for name in ALARMING_MODULES:
        if (ROOT / name).exists():
            yield from _iter_alarms(ROOT / name)


@cache
def parse_module(path: Path) -> ast.Module:
    """The tree of a module, which several look through."""
    return ast.parse(path.read_text(encoding="utf-8"))


def _iter_alarms(path: Path) -> Iterator[str]:
    """Sentences anywhere in a module, but for its descriptions."""
    waiting: list[ast.AST] = [parse_module(path)]
    while waiting:
        node = waiting.pop()
        key = build_key(node)
        if key is None:
            waiting += [each for each in ast.iter_child_nodes(node) if not _is_docstring(each)]
        elif _is_sentence(key):
            yield key


def _iter_refusals(path: Path) -> Iterator[str]:
    """What the errors of a module say."""
    if "raise " not in path.read_text(encoding="utf-8"):
        return
    for node in ast.walk(parse_module(path)):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and node.exc.args:
            yield from _iter_keys(node.exc.args[0], least_words=1)


def _iter_told(path: Path) -> Iterator[str]:
    """Sentences in the functions of a module that tell something, and in its constants."""
    module = parse_module(path)
    for constant in module.body:
        if isinstance(constant, ast.Assign | ast.AnnAssign) and constant.value is not None:
            yield from _iter_keys(constant.value)
    for node in ast.walk(module):
        if isinstance(node, ast.FunctionDef) and _TELLING_NAME.search(node.name):
            for statement in node.body:
                if not _is_docstring(statement):
                    yield from _iter_keys(statement)


def _is_docstring(statement: ast.AST) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


def _iter_keys(node: ast.AST, least_words: int = LEAST_WORDS) -> Iterator[str]:
    """Strings that are sentences in a piece of code; the pieces of an f-string are one."""
    key = build_key(node)
    if key is not None:
        if _is_sentence(key, least_words):
            yield key
        return
    for child in ast.iter_child_nodes(node):
        yield from _iter_keys(child, least_words)


def build_key(node: ast.AST) -> str | None:
    """The key of a literal or an f-string: ``{width_m}`` where a value stands; None for other code."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if not isinstance(node, ast.JoinedStr):
        return None
    parts, names = [], dict[str, str]()
    for value in node.values:
        if isinstance(value, ast.Constant):
            parts.append(str(value.value))
        elif isinstance(value, ast.FormattedValue):
            source = ast.unparse(value.value)
            parts.append(f"{{{_name_value(value.value, source, names)}}}")
    return "".join(parts)


def _name_value(value: ast.expr, source: str, names: dict[str, str]) -> str:
    """A name for a value: that of the variable, of the attribute or of the function; another for another value."""
    if source in names:
        return names[source]
    if isinstance(value, ast.Call):
        value = value.args[0] if value.args and not isinstance(value.func, ast.Attribute) else value.func
    found = value.attr if isinstance(value, ast.Attribute) else value.id if isinstance(value, ast.Name) else "value"
    name = re.sub(r"\W", "", found).strip("_") or "value"
    taken, number = set(names.values()), 2
    unique = name
    while unique in taken:
        unique, number = f"{name}{number}", number + 1
    names[source] = unique
    return unique


def _is_sentence(key: str, least_words: int = LEAST_WORDS) -> bool:
    """Whether a string is read by people: some words, not only values."""
    bare = re.sub(r"\{\w+\}", " ", key)
    words = re.findall(r"[A-Za-z]{2,}", bare)
    is_long = len(words) >= least_words and sum(map(len, words)) >= LEAST_LETTERS * least_words / LEAST_WORDS
    return is_long and " " in bare.strip() and "\n" not in key
