"""What the table of the house counts in a checkout of two modules, and how it stands beside another."""

from collections.abc import Mapping
from pathlib import Path

import pytest

from tests.benchmarks.house import COLUMNS, PACKAGES, count_checkout, find_package, format_table, main

SHAPES = '''"""Shapes."""
from dataclasses import dataclass
SIDES, ANGLE_DEG = 4, 90.0
DAY_S = 24 * 60 * 60
LIMITS_M = (1.5, -2.0)
TITLE, FLAGS = "4", (True, False)
LARGEST = max(1, 2)


@dataclass(frozen=True)
class Square:
    side_m: float = 3.0

    @property
    def area_m2(self) -> float:
        def multiply() -> float:
            return self.side_m * self.side_m
        return multiply()


class Named:
    def __init__(self) -> None:
        self.square = Square(2.0)
'''
USE = """from fields.layout import shapes
from fields.layout.shapes import Square


def add_areas(squares: list[Square]) -> float:
    return sum(square.area_m2 + square.area_m2 for square in squares)
"""
TEST = """from fields.layout.shapes import Square
def test_area() -> None:
    assert Square(2.0).area_m2 == helped()
def helped() -> float:
    return 4.0
"""


@pytest.fixture
def counted(tmp_path: Path) -> Mapping[str, Mapping[str, int]]:
    files = {
        "fields/layout/shapes.py": SHAPES,
        "fields/__init__.py": "",
        "planner/risk/use.py": USE,
        "tests/test_shapes.py": TEST,
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return count_checkout(tmp_path)


@pytest.mark.parametrize(
    ("package", "expected"),
    [
        # lines, modules, classes, dataclasses, built once, functions, used once, numbers, one importer, longest
        ("fields/layout", (SHAPES.count("\n"), 1, 2, 1, 1, 3, 1, 4, 1, 5)),
        ("planner core", (USE.count("\n"), 1, 0, 0, 0, 1, 0, 0, 0, 2)),
        ("fields", (0,) * 10),
        ("together", (SHAPES.count("\n") + USE.count("\n"), 2, 2, 1, 1, 4, 1, 4, 1, 5)),
        ("tests", (TEST.count("\n"), 1, 0, 0, 0, 2, 1, 0, 0, 2)),
    ],
)
def test_a_package_is_counted(
    counted: Mapping[str, Mapping[str, int]], package: str, expected: tuple[int, ...]
) -> None:
    assert counted[package] == dict(zip(COLUMNS, expected, strict=True))


def test_another_checkout_stands_beside_it(counted: Mapping[str, Mapping[str, int]]) -> None:
    smaller = {name: {**row, "lines": row["lines"] - 2} for name, row in counted.items()}
    lines = list(format_table(smaller, counted))
    assert lines[0].split()[:2] == ["package", "lines"] and len(lines) == 1 + 3 * len(PACKAGES) + 3
    first = next(index for index, line in enumerate(lines) if line.startswith("together"))
    here, base, change = (line.replace("together", "").split()[:3] for line in lines[first : first + 3])
    assert (here[0], base[0], change[:3]) == ("here", "base", ["change", "-2", "+0"])
    assert int(base[1]) - int(here[1]) == 2
    assert len({len(line) for line in lines}) == 1


def test_every_module_of_this_checkout_has_a_package(capsys: pytest.CaptureFixture[str]) -> None:
    assert find_package("vehicle/identification/logs/readings.py") == "identification"
    assert find_package("vehicle/model/effects.py") == "vehicle"
    assert find_package("planner/errors.py") == "elsewhere"
    main([])
    table = {
        line.rsplit(maxsplit=len(COLUMNS))[0]: line.split()[-len(COLUMNS)]
        for line in capsys.readouterr().out.splitlines()[1:]
    }
    assert set(table) == {*PACKAGES, "together"} and all(int(lines.replace(",", "")) > 0 for lines in table.values())
