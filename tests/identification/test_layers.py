"""Every module of the layers is tested by its name, and every threshold has a word."""

import ast
from itertools import pairwise
from pathlib import Path

import pytest

import vehicle.identification

PACKAGE = Path(vehicle.identification.__file__).parent
LAYERS = ("logs", "faults", "replay", "residuals", "fit", "cause_selection", "model_extension", "verdict")
TESTS = Path(__file__).parents[1]


def imported(path: Path) -> set[str]:
    """Dotted names of modules that a file imports, inside functions as well."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{one.name}" for one in node.names)}
        elif isinstance(node, ast.Import):
            names |= {one.name for one in node.names}
    return names


@pytest.fixture(scope="module")
def tested() -> set[str]:
    """Modules that some test imports."""
    return set().union(*(imported(path) for path in TESTS.rglob("test_*.py")))


@pytest.mark.slow
@pytest.mark.parametrize("layer", LAYERS)
def test_every_module_is_imported_by_a_test(layer: str, tested: set[str]) -> None:
    for path in (PACKAGE / layer).glob("[a-z]*.py"):
        assert f"vehicle.identification.{layer}.{path.stem}" in tested, path.name


def test_thresholds_know_nobody_and_each_has_a_word() -> None:
    """Every constant stands under a comment that says where it comes from."""
    lines = (PACKAGE / "thresholds.py").read_text(encoding="utf-8").splitlines()
    assert imported(PACKAGE / "thresholds.py") == {"__future__", "__future__.annotations"}
    for before, line in pairwise(lines):
        if line[:1].isupper() and " = " in line:
            assert before.startswith("# ") and not before.startswith("# ---"), line
