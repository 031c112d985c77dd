"""The structure of the source: who imports whom, no circles between packages, and sizes.

Imports are read from the source, those inside functions and those for type checking too. Faces (`__init__` modules that
only hand names on) are left out of the graph of packages.
"""

import ast
import re
import statistics
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

import fields
import planner
from strategies.names import STRATEGY_NAMES

ROOT = Path(__file__).parents[1]
TOP_PACKAGES = ("fields", "vehicle", "strategies", "reports", "planner")
IDENTIFICATION_LAYERS = ("logs", "faults", "replay", "diagnosis")
MAX_MODULES, MAX_LINES, MAX_BODY_LINES, MAX_ROOT_MODULES, MAX_OWN_IMPORTS = 470, 500, 60, 8, 3430
# Modules, and imports of own modules (types of arrays too): what there is and ten more with theirs, so that a strategy
# or a format may be added.
MAX_PAGE_WORDS = 1250  # two pages of A4 with their tables

MAY_IMPORT: dict[str, tuple[str, ...]] = {
    "fields": ("fields",),
    "vehicle": ("vehicle", "fields.arrays", "fields.errors", "fields.units", "fields.text_files", "fields.nested_text"),
    "strategies": ("strategies", "fields", "vehicle"),
    "reports": (
        "reports", "fields.arrays", "fields.errors", "fields.units", "fields.geometry.arithmetic", "fields.formats",
        "fields.documents.reader",
        "vehicle.model", "vehicle.missions.run",
        "vehicle.identification.diagnosis.results", "vehicle.identification.diagnosis.demo_logs",
        "vehicle.trials.sheets",
    ),
    "planner": ("planner", "fields", "vehicle", "strategies", "reports"),
}  # fmt: skip
"""What each top-level package may import; reports know result types, runs among them, and what guidance files hold."""
SERVICE_COMMANDS = ("planner.cli.server", "planner.cli.robots")
BY_NAME = {
    "fields", "fields.formats.format_records", "planner", "planner.cli.alias.headland", "planner.pipeline.kernels",
    "strategies.registry",
}  # fmt: skip
"""Modules that import others by a name made at run time."""

Graph = dict[str, set[str]]


def list_modules() -> dict[str, Path]:
    """Every source module by its dotted name; a package is its __init__."""
    found = {}
    for top in TOP_PACKAGES:
        for path in sorted((ROOT / top).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def iter_imports(nodes: Iterable[ast.AST], path: Path, modules: dict[str, Path]) -> Iterator[str]:
    """Own modules that a file imports anywhere; `from a import b` is a.b where that is a module."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in modules)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively; write the whole name"
            for alias in node.names:
                full_name = f"{node.module}.{alias.name}"
                if full_name in modules or node.module in modules:
                    yield full_name if full_name in modules else str(node.module)


@pytest.fixture(scope="module")
def modules() -> dict[str, Path]:
    return list_modules()


@pytest.fixture(scope="module")
def read_modules(modules: dict[str, Path]) -> dict[str, tuple[set[str], dict[str, int]]]:
    """Of every module what it imports and the lines of the bodies of its functions, from one reading."""
    found = {}
    for name, path in modules.items():
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        lines: dict[str, int] = {}
        for node in nodes:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.end_lineno is not None:
                first = node.body[min(1, len(node.body) - 1) if ast.get_docstring(node) else 0]
                lines[node.name] = max(lines.get(node.name, 0), node.end_lineno - first.lineno + 1)
        found[name] = set(iter_imports(nodes, path, modules)), lines
    return found


@pytest.fixture(scope="module")
def graph(read_modules: dict[str, tuple[set[str], dict[str, int]]]) -> Graph:
    edges = {name: imports - {name} for name, (imports, _) in read_modules.items()}
    # Imported by name.
    edges["strategies.registry"] |= {f"strategies.{name.replace('-', '_')}" for name in STRATEGY_NAMES}
    formats, finder = {name for name in edges if name.startswith("fields.formats.")}, "fields.formats.format_records"
    edges[finder] |= formats - {finder}
    return edges


@pytest.fixture(scope="module")
def plain_graph(graph: Graph, modules: dict[str, Path]) -> Graph:
    """The graph without faces."""
    faces = {name for name, path in modules.items() if path.name == "__init__.py"}
    return {name: others - faces for name, others in graph.items() if name not in faces}


def is_below(name: str, places: tuple[str, ...]) -> bool:
    """Whether a module is one of these places or inside one."""
    return any(name == place or name.startswith(f"{place}.") for place in places)


def find_circles(graph: Graph) -> list[frozenset[str]]:
    """Sets of nodes that reach one another (Tarjan's strongly connected components of more than one)."""
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[frozenset[str]] = []

    def visit(node: str) -> None:
        order[node] = low[node] = len(order)
        stack.append(node)
        for other in sorted(graph[node]):
            if other not in order:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], order[other])
        if low[node] == order[node]:
            place = stack.index(node)
            if len(stack) - place > 1:
                found.append(frozenset(stack[place:]))
            del stack[place:]

    for node in sorted(graph):
        if node not in order:
            visit(node)
    return found


def find_package_circles(graph: Graph) -> list[frozenset[str]]:
    """Circles among what lies directly in a package, at any depth; its own modules together are one node."""

    def find_child(package: str, name: str) -> str | None:
        if package and not name.startswith(f"{package}."):
            return None
        rest = name[len(package) + 1 :] if package else name
        return f"{package}.{rest.split('.')[0]}".lstrip(".") if "." in rest or not package else f"{package}.*"

    packages = {""} | {".".join(name.split(".")[:depth]) for name in graph for depth in range(1, name.count(".") + 1)}
    found = []
    for package in sorted(packages):
        edges: Graph = {}
        for name, others in graph.items():
            child = find_child(package, name)
            if child is not None:
                targets = {find_child(package, other) for other in others} - {None, child}
                edges.setdefault(child, set()).update(str(target) for target in targets)
        found += find_circles({node: targets & edges.keys() for node, targets in edges.items()})
    return found


def imports_by_name(path: Path) -> bool:
    """Whether a file can import what no import statement of it names."""
    text, ways = (
        path.read_text(encoding="utf-8"),
        {"import_module", "__import__", "find_spec", "run_module", "exec", "eval"},
    )
    if not any(way in text for way in ways):
        return False
    names = {getattr(node, key, "") for node in ast.walk(ast.parse(text)) for key in ("id", "attr", "name")}
    return bool(names & ways)


def test_circles_are_found() -> None:
    assert find_circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a", "e"}, "e": set()}) == [frozenset("bc")]
    assert find_circles({"a": {"b"}, "b": set()}) == []
    assert find_package_circles({"p.a": {"p.q.c"}, "p.b": set(), "p.q.c": {"p.b"}}) == [frozenset({"p.*", "p.q"})]
    assert find_package_circles({"p.a": {"p.q.c"}, "p.b": set(), "p.q.c": set()}) == []


def test_the_graph_has_imports_of_every_form(graph: Graph) -> None:
    assert len(graph) > 100
    assert "vehicle.jit" in graph["vehicle.sim.loop"]  # at the top of a file
    assert "planner.pipeline.planning" in graph["planner.cli.plan"]  # inside a function


def test_imports_by_name_are_all_in_the_graph(graph: Graph, modules: dict[str, Path]) -> None:
    assert {name for name, path in modules.items() if imports_by_name(path)} == BY_NAME
    for face in (fields, planner):  # what is loaded on demand stands there for type checking as well
        assert {f"{face.__name__}.{home}" for home in face._HOMES} == graph[face.__name__]
        assert {name for names in face._HOMES.values() for name in names} == set(face.__all__)
        assert all(getattr(face, name) is not None for name in face.__all__)


@pytest.mark.parametrize("top", TOP_PACKAGES)
def test_a_top_level_package_imports_only_what_it_may(graph: Graph, top: str) -> None:
    inside = {name: others for name, others in graph.items() if is_below(name, (top,))}
    wrong = {f"{name} -> {other}" for name in inside for other in inside[name] if not is_below(other, MAY_IMPORT[top])}
    assert wrong == set()


def test_no_circle_of_modules(graph: Graph) -> None:
    assert find_circles(graph) == []


def test_no_circle_of_packages_at_any_depth(plain_graph: Graph) -> None:
    assert find_package_circles(plain_graph) == []


def test_layers_of_identification_stand_in_one_order(graph: Graph) -> None:
    level = {f"vehicle.identification.{layer}": number for number, layer in enumerate(IDENTIFICATION_LAYERS)}

    def find_level(name: str) -> int | None:
        return level.get(".".join(name.split(".")[:3]))

    upwards = {
        f"{name} -> {other}"
        for name, others in graph.items()
        for other in others
        if (own := find_level(name)) is not None and (target := find_level(other)) is not None and target > own
    }
    assert upwards == set()
    assert {find_level(name) for name in graph} >= set(range(len(IDENTIFICATION_LAYERS)))


def test_the_vehicle_does_without_its_identification(graph: Graph) -> None:
    above = ("vehicle.identification", "vehicle.trials", "vehicle.twin")
    simulator = {
        name: others for name, others in graph.items() if is_below(name, ("vehicle",)) and not is_below(name, above)
    }
    assert {name for name, others in simulator.items() if any(is_below(other, above[:1]) for other in others)} == set()


def test_nobody_imports_the_command_line(graph: Graph) -> None:
    outside = {name: others for name, others in graph.items() if not is_below(name, ("planner.cli",))}
    assert {
        name for name, others in outside.items() if any(is_below(other, ("planner.cli",)) for other in others)
    } == set()


def test_only_its_own_commands_import_the_service(graph: Graph) -> None:
    service = ("planner.service",)
    outside = {name: others for name, others in graph.items() if not is_below(name, (*service, *SERVICE_COMMANDS))}
    assert {name for name, others in outside.items() if any(is_below(other, service) for other in others)} == set()


def test_sizes(modules: dict[str, Path], plain_graph: Graph) -> None:
    lines = {name: len(modules[name].read_text(encoding="utf-8").splitlines()) for name in plain_graph}
    assert len(lines) <= MAX_MODULES
    assert {name: count for name, count in lines.items() if count > MAX_LINES} == {}
    assert 130 <= statistics.median(lines.values()) <= 220
    assert sum(len(others) for others in plain_graph.values()) <= MAX_OWN_IMPORTS
    strategy_modules = {f"strategies.{name.replace('-', '_')}" for name in STRATEGY_NAMES}
    in_roots = [name for name in lines.keys() - strategy_modules if name.count(".") == 1]
    roots = {top: sum(name.startswith(f"{top}.") for name in in_roots) for top in TOP_PACKAGES}
    assert {top: count for top, count in roots.items() if count > MAX_ROOT_MODULES} == {}


def test_functions_are_short(read_modules: dict[str, tuple[set[str], dict[str, int]]]) -> None:
    long = {
        f"{name}.{function}": count
        for name, (_, lines) in read_modules.items()
        for function, count in lines.items()
        if count > MAX_BODY_LINES
    }
    assert long == {} and sum(len(lines) for _, lines in read_modules.values()) > 1000


def test_top_level_packages_say_that_they_are_typed() -> None:
    assert [top for top in TOP_PACKAGES if not (ROOT / top / "py.typed").is_file()] == []


def test_the_page_on_architecture_is_two_pages_and_names_what_there_is() -> None:
    page = (ROOT / "planner/guide/architecture.md").read_text(encoding="utf-8")
    assert len(page.split()) <= MAX_PAGE_WORDS
    paths = re.findall(r"`([^`<> ]+/[^`<> ]+)`", page)
    assert len(paths) > 20 and [path for path in paths if not (ROOT / path).exists()] == []
    table = page.split("| package of `planner` | holds |")[1].split("##")[0]
    named = {
        name for row in table.splitlines() if row.count("|") > 2 for name in re.findall(r"`(\w+)`", row.split("|")[1])
    }
    assert named == {path.parent.name for path in (ROOT / "planner").glob("*/__init__.py")}


@pytest.mark.slow
def test_overlays_without_a_grid_are_made_in_one_place_that_knows_when_they_fail(modules: dict[str, Path]) -> None:
    overlays = "difference", "intersection", "union", "union_all"
    for name, file in modules.items():
        calls = [node for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]
        made = [one for one in calls if isinstance(one.func, ast.Attribute) and one.func.attr in overlays]
        plain = [ast.unparse(one) for one in made if all(keyword.arg != "grid_size" for keyword in one.keywords)]
        assert name == "fields.geometry.overlays" or not [one for one in plain if one.startswith("shapely.")]
