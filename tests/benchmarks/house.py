"""How large the house is, by package, out of the syntax of its sources: nothing of it is imported or run.

    python -m tests.benchmarks.house [--against CHECKOUT]

`--against` counts another checkout as well and prints, for every package, both and the difference. Counted are files
of Python; scripts and styles of pages are not. What is referred to is told by name: two functions of one name count
as one, and a name in a string or a table is not seen. Sources are compared with sources, tests with tests.

- lines: with blank lines, comments and docstrings.
- modules: all files but `__init__.py`.
- classes: `class` statements at any depth; dataclasses: those that a decorator called `dataclass` makes.
- built once: dataclasses that are called in one place.
- functions: `def` statements at any depth, with methods and properties, without lambdas.
- used once: functions whose name stands once as a name or an attribute, imports and definitions aside. Names that
  Python or pytest calls (`__init__`, `test_...`) are left out.
- numbers: names that a module sets by numbers written out, alone, in arithmetic or in a tuple: `A = 3`, `B, C = 1, 2`,
  `D = (60 * 24, 7)`. Defaults of parameters and fields are not counted.
- one importer: modules that one other module imports.
- longest: lines of the longest function, decorators and docstring included.
"""

import argparse
import ast
import gc
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
TESTS, ELSEWHERE = "tests", "elsewhere"
PACKAGES: Mapping[str, tuple[str, ...]] = {
    "identification": ("vehicle/identification",),
    "vehicle": ("vehicle",),
    "fields/layout": ("fields/layout",),
    "fields": ("fields",),
    "strategies": ("strategies",),
    "planner core": tuple(f"planner/{name}" for name in ("evaluation", "pipeline", "traffic", "risk")),
    **{name: (f"planner/{name}",) for name in ("cli", "request", "farm", "day", "task_logs", "fleet", "service")},
    "reports": ("reports",),
    ELSEWHERE: ("planner",),
    TESTS: ("tests",),
}
"""Folders of each package; what a package before has taken is not counted again."""
COLUMNS = (
    "lines", "modules", "classes", "dataclasses", "built once",
    "functions", "used once", "numbers", "one importer", "longest",
)  # fmt: skip
TOGETHER = "together"
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
ARITHMETIC = (ast.Constant, ast.Tuple, ast.UnaryOp, ast.BinOp)

Counts = Mapping[str, int]


@dataclass
class ModuleCounts:
    """What one file of Python holds, and which names it uses how often."""

    lines: int
    is_package: bool = False
    classes: int = 0
    dataclasses: list[str] = field(default_factory=list)
    functions: list[str] = field(default_factory=list)
    numbers: int = 0
    longest: int = 0
    names: Counter[str] = field(default_factory=Counter)
    calls: Counter[str] = field(default_factory=Counter)
    imports: set[str] = field(default_factory=set)


def walk(tree: ast.AST) -> Iterator[ast.AST]:
    """A tree and all below it without operators and contexts, several times as quick as ast.walk."""
    nodes = [tree]
    while nodes:
        node = nodes.pop()
        yield node
        for name in node._fields:
            value = getattr(node, name, None)
            if isinstance(value, list):
                nodes.extend(each for each in value if isinstance(each, ast.AST))
            elif isinstance(value, ast.AST) and name not in ("ctx", "op"):
                nodes.append(value)


def get_name(node: ast.AST) -> str:
    """The last part of a name or an attribute; nothing for another node."""
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""


def count_numbers(statement: ast.stmt) -> int:
    """How many names this statement of a module sets by numbers alone."""
    if not isinstance(statement, (ast.Assign, ast.AnnAssign)) or statement.value is None:
        return 0
    nodes = list(walk(statement.value))
    values = [node.value for node in nodes if isinstance(node, ast.Constant)]
    if not values or not all(type(value) in (int, float) for value in values):
        return 0
    if not all(isinstance(node, ARITHMETIC) for node in nodes):
        return 0
    target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
    return len(target.elts) if isinstance(target, ast.Tuple) else 1


def count_module(source: str, is_package: bool = False) -> ModuleCounts:
    """The counts of one file."""
    tree = ast.parse(source)
    counts = ModuleCounts(source.count("\n"), is_package, numbers=sum(map(count_numbers, tree.body)))
    for node in walk(tree):
        if name := get_name(node):
            counts.names[name] += 1
        elif isinstance(node, ast.Call):
            counts.calls[get_name(node.func)] += 1
        elif isinstance(node, FUNCTIONS):
            counts.functions.append(node.name)
            first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
            counts.longest = max(counts.longest, (node.end_lineno or first) - first + 1)
        elif isinstance(node, ast.ClassDef):
            counts.classes += 1
            decorators = [each.func if isinstance(each, ast.Call) else each for each in node.decorator_list]
            if "dataclass" in map(get_name, decorators):
                counts.dataclasses.append(node.name)
        elif isinstance(node, ast.Import):
            counts.imports.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            counts.imports.update((node.module, *(f"{node.module}.{alias.name}" for alias in node.names)))
    return counts


def find_package(path: str) -> str:
    """The package of a file, by its path in the checkout."""
    return next(name for name, folders in PACKAGES.items() if any(path.startswith(f"{folder}/") for folder in folders))


def count_tree(modules: Mapping[str, ModuleCounts]) -> Iterator[tuple[str, Counts]]:
    """By path, what a package gains by each module among these: columns of COLUMNS."""
    names: Counter[str] = Counter()
    calls: Counter[str] = Counter()
    importers: dict[str, set[str]] = defaultdict(set)
    for path, module in modules.items():
        names.update(module.names)
        calls.update(module.calls)
        for imported in module.imports:
            importers[imported].add(path)
    for path, module in modules.items():
        dotted = path.removesuffix(".py").replace("/", ".")
        named = [name for name in module.functions if not name.startswith(("__", "test_"))]
        values = (
            module.lines,
            int(not module.is_package),
            module.classes,
            len(module.dataclasses),
            sum(calls[name] == 1 for name in module.dataclasses),
            len(module.functions),
            sum(names[name] == 1 for name in named),
            module.numbers,
            int(not module.is_package and len(importers[dotted]) == 1),
            module.longest,
        )
        yield path, dict(zip(COLUMNS, values, strict=True))


def add_counts(rows: Iterable[Counts]) -> Counts:
    """The sum of rows; of the longest functions the longest."""
    listed = list(rows)
    sums = {name: sum(row[name] for row in listed) for name in COLUMNS}
    return {**sums, "longest": max((row["longest"] for row in listed), default=0)}


def count_checkout(root: Path) -> Mapping[str, Counts]:
    """The counts of each package of PACKAGES, of all but the tests together, and of the tests."""
    sources: dict[str, ModuleCounts] = {}
    tests: dict[str, ModuleCounts] = {}
    for top in sorted({folder.partition("/")[0] for folders in PACKAGES.values() for folder in folders}):
        for file in sorted((root / top).rglob("*.py")):
            path = file.relative_to(root).as_posix()
            module = count_module(file.read_text(encoding="utf-8"), file.name == "__init__.py")
            (tests if top == TESTS else sources)[path] = module
    rows: dict[str, list[Counts]] = {name: [] for name in PACKAGES}
    for tree in (sources, tests):
        for path, row in count_tree(tree):
            rows[find_package(path)].append(row)
    test_rows = rows.pop(TESTS)
    return {
        **{name: add_counts(package) for name, package in rows.items()},
        TOGETHER: add_counts(row for package in rows.values() for row in package),
        TESTS: add_counts(test_rows),
    }


def format_table(now: Mapping[str, Counts], base: Mapping[str, Counts] | None = None) -> Iterator[str]:
    """Lines of the table; with another checkout three for each package."""
    width = max(map(len, now)) + 2
    widths = [max(len(name), 8) + 2 for name in COLUMNS]

    def format_row(name: str, which: str, cells: Sequence[str]) -> str:
        fitted = "".join(f"{cell:>{size}}" for cell, size in zip(cells, widths, strict=True))
        return f"{name:<{width}}{which:<{8 if base else 0}}{fitted}"

    yield format_row("package", "", COLUMNS)
    for name, row in now.items():
        cells = [f"{row[column]:,}" for column in COLUMNS]
        if base is None:
            yield format_row(name, "", cells)
            continue
        yield format_row(name, "here", cells)
        yield format_row("", "base", [f"{base[name][column]:,}" for column in COLUMNS])
        yield format_row("", "change", [f"{row[column] - base[name][column]:+,}" for column in COLUMNS])


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table of this checkout, or of this and another."""
    parser = argparse.ArgumentParser(description="Count lines, classes, functions and numbers of every package.")
    parser.add_argument("--against", type=Path, metavar="CHECKOUT", help="count this checkout too, as base")
    options = parser.parse_args(arguments)
    base = count_checkout(options.against) if options.against else None
    print(*format_table(count_checkout(ROOT), base), sep="\n")


if __name__ == "__main__":
    gc.disable()  # trees are many objects without cycles
    main()
