"""Names: functions begin with a verb, classes have one home, and words that the glossary replaced name nothing."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

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


def iter_functions() -> Iterator[FunctionName]:
    """All functions and methods of the source, without properties, constructors and special methods."""
    for module, path in list_modules().items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not node.name.startswith("__"):
                decorators = " ".join(ast.unparse(decorator) for decorator in node.decorator_list)
                if "property" not in decorators and "setter" not in decorators:
                    yield FunctionName(f"{module}:{node.lineno}", node.name.lstrip("_"))


def iter_identifiers() -> Iterator[FunctionName]:
    """Every name that the source gives to something: modules, classes, functions, parameters, fields and variables."""
    for module, path in list_modules().items():
        yield FunctionName(module, module.rsplit(".", 1)[-1])
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            name = ""
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                name = node.name
            elif isinstance(node, ast.arg):
                name = node.arg
            elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                name = node.id
            elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
                name = node.attr
            if name:
                yield FunctionName(f"{module}:{getattr(node, 'lineno', 0)}", name)


def split_words(name: str) -> list[str]:
    """Words of a name in snake_case or CamelCase, in lower case."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower().strip("_").split("_")


def test_words_are_split() -> None:
    assert split_words("_FleetPlan") == ["fleet", "plan"] and split_words("lay_swaths") == ["lay", "swaths"]
    assert all(name.split("_")[0] in VERBS for name in EXAMPLES_OF_VERBS)
    assert not VERBS & {"driven", "told", "scenario", "tractor", "speed", "mended", "known"}


def test_functions_begin_with_a_verb() -> None:
    functions = list(iter_functions())
    without = [function for function in functions if split_words(function.name)[0] not in VERBS]
    assert len(functions) > 3000
    assert len(without) <= (1 - MIN_VERB_SHARE) * len(functions), without


def test_no_bare_participle_names_a_function() -> None:
    functions = list(iter_functions())
    bare = [each for each in functions if PARTICIPLE.fullmatch(each.name) and each.name not in VERBS]
    assert len(bare) <= MAX_PARTICIPLE_SHARE * len(functions), bare


def test_a_class_name_has_one_home() -> None:
    homes: dict[str, set[str]] = defaultdict(set)
    for module, path in list_modules().items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                homes[node.name].add(module)
    assert sum(len(places) > 1 for places in homes.values()) <= MAX_SHARED_CLASS_NAMES


def test_words_that_the_glossary_replaced_name_nothing() -> None:
    found = [each for each in iter_identifiers() if set(split_words(each.name)) & set(REPLACED)]
    assert found == []


def test_the_glossary_has_the_words_that_were_replaced() -> None:
    text = (
        (ROOT / "planner" / "guide" / "glossary.md").read_text(encoding="utf-8").split("## Words that were replaced")[1]
    )
    known = set(re.findall(r"\w+", text))
    roots = {"told", "asked", "mend", "cure", "rival", "berth", "odds", "surprise", "knob", "storey", "abreast"}
    assert roots <= known
