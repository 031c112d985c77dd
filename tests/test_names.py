"""Names: functions begin with a verb, classes have one home, and words that the glossary replaced name nothing."""

import ast
import re
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.test_structure import ROOT, list_modules

VERBS = frozenset((Path(__file__).parent / "verbs.txt").read_text(encoding="utf-8").split())
MIN_VERB_SHARE, MAX_PARTICIPLE_SHARE, MAX_SHARED_CLASS_NAMES = 0.9, 0.0, 0
REPLACED = (
    "told", "asked", "rubbing", "mended", "mend", "mending", "cure", "cures", "foresight", "foreseen", "foretelling",
    "outlook", "rival", "rivals", "beaten", "trampled", "berth", "berths", "odds", "stakes", "yielding", "homeward",
    "obeying", "surprise", "surprises", "knob", "knobs", "storey", "storeys", "abreast", "laps",
    "lap", "stretches", "trampling", "promise", "bye",
)  # fmt: skip
"""Words of the last table of planner/guide/glossary.md that have no other sense in code."""
PARTICIPLE = re.compile(r"[a-z]+(ed|ing)|told|kept|laid|made|found|left|done|gone|known|driven|built|drawn|shown|taken")
EXAMPLES_OF_VERBS = ("find_conflicts", "lay_swaths", "compute_slip_angle", "is_feasible")


class FunctionName(NamedTuple):
    place: str
    name: str


class SourceNames(NamedTuple):
    """Names of the source: functions and methods without properties, constructors and special methods; whatever gets a
    name (modules, classes, functions, parameters, fields and variables); and the modules of each class name."""

    functions: list[FunctionName]
    identifiers: list[FunctionName]
    class_homes: dict[str, set[str]]


@pytest.fixture(scope="module")
def names() -> SourceNames:
    """Read once: to parse the source takes seconds."""
    found = SourceNames([], [], defaultdict(set))
    for module, path in list_modules().items():
        found.identifiers.append(FunctionName(module, module.rsplit(".", 1)[-1]))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            add_names(found, module, node)
    return found


def add_names(found: SourceNames, module: str, node: ast.AST) -> None:
    """Add what a node of a module's tree names."""
    name = ""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        name = node.name
        decorators = " ".join(ast.unparse(decorator) for decorator in node.decorator_list)
        if not name.startswith("__") and "property" not in decorators and "setter" not in decorators:
            found.functions.append(FunctionName(f"{module}:{node.lineno}", name.lstrip("_")))
    elif isinstance(node, ast.ClassDef):
        name = node.name
        found.class_homes[name].add(module)
    elif isinstance(node, ast.arg):
        name = node.arg
    elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
        name = node.id
    elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
        name = node.attr
    if name:
        found.identifiers.append(FunctionName(f"{module}:{getattr(node, 'lineno', 0)}", name))


def split_words(name: str) -> list[str]:
    """Words of a name in snake_case or CamelCase, in lower case."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower().strip("_").split("_")


def test_words_are_split() -> None:
    assert split_words("_FleetPlan") == ["fleet", "plan"] and split_words("lay_swaths") == ["lay", "swaths"]
    assert all(name.split("_")[0] in VERBS for name in EXAMPLES_OF_VERBS)
    assert not VERBS & {"driven", "told", "scenario", "tractor", "speed", "mended", "known"}


def test_functions_begin_with_a_verb(names: SourceNames) -> None:
    functions = names.functions
    without = [function for function in functions if split_words(function.name)[0] not in VERBS]
    assert len(functions) > 3000
    assert len(without) <= (1 - MIN_VERB_SHARE) * len(functions), without


def test_no_bare_participle_names_a_function(names: SourceNames) -> None:
    functions = names.functions
    bare = [each for each in functions if PARTICIPLE.fullmatch(each.name) and each.name not in VERBS]
    assert len(bare) <= MAX_PARTICIPLE_SHARE * len(functions), bare


def test_a_class_name_has_one_home(names: SourceNames) -> None:
    assert len(names.class_homes) > 500
    assert sum(len(places) > 1 for places in names.class_homes.values()) <= MAX_SHARED_CLASS_NAMES


def test_words_that_the_glossary_replaced_name_nothing(names: SourceNames) -> None:
    assert len(names.identifiers) > 30_000
    found = [each for each in names.identifiers if set(split_words(each.name)) & set(REPLACED)]
    assert found == []


def test_the_glossary_has_the_words_that_were_replaced() -> None:
    text = (
        (ROOT / "planner" / "guide" / "glossary.md").read_text(encoding="utf-8").split("## Words that were replaced")[1]
    )
    known = set(re.findall(r"\w+", text))
    roots = {"told", "asked", "mend", "cure", "rival", "berth", "odds", "surprise", "knob", "storey", "abreast"}
    assert roots <= known
