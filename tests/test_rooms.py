"""Rooms import one way: no circle of rooms, of files, or of the storeys of `vehicle.measured`.

Imports are read from the source, those inside functions too. Those for type checking alone count as well: whoever
reads a file has to know what they name.
"""

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

import planner
from strategies.names import NAMES

ROOT = Path(__file__).parents[1]
ROOMS = ("fields", "vehicle", "strategies", "reports", "planner")
STOREYS = ("logs", "replay", "surprise", "fit", "causes", "mend", "answer")

RESULTS_OF_OTHERS = (
    "fields.read",  # what a file of several fields holds
    "vehicle.effects",  # words and units of effects
    "vehicle.rest",
    "vehicle.tractor",
    "vehicle.measured.answer",  # verdicts, findings, what a demonstration had hidden
    "vehicle.trials.sheets.sheet",
)
"""Modules that hold what reports are handed; the rest of those rooms they do not know."""
FORMULAS_OF_OTHERS = ("fields.plane",)
"""Metres of a form that is read as well as written: a formula has one place."""

MAY_KNOW: dict[str, tuple[str, ...]] = {
    "fields": ("fields",),
    "vehicle": ("vehicle", "fields.errors", "fields.reading"),
    "strategies": ("strategies", "fields", "vehicle"),
    "reports": ("reports", "fields.errors", *RESULTS_OF_OTHERS, *FORMULAS_OF_OTHERS),
    "planner": ("planner", "fields", "vehicle", "strategies", "reports"),
}
COMMAND_LINE = ("planner.commands", "planner.main")
SERVICE = ("planner.service",)
OF_SERVICE = tuple(f"planner.commands.{name}" for name in ("backup", "demo", "robot", "serve", "token"))
"""Commands that know the service; planning and every other command do without it."""
BY_NAME = {"planner", "strategies.registry"}
"""Modules that import others by a name made at run time; the tests below say which those are."""

MAPPED = (
    *ROOMS,
    *(f"planner/{name}" for name in ("candidates", "chance", "day", "farm", "ground", "many", "price", "yielding")),
    *(f"planner/works{part}" for part in ("", "/forms")),
    *(f"strategies/{name}" for name in ("formations", "headland", "orders", "ways")),
    *(f"planner/service{part}" for part in ("", "/access", "/api", "/jobs", "/store")),
    "reports/guidance",
    "vehicle/measured",
    "vehicle/trials",
    "vehicle/twin",
)
"""Packages whose __init__ says what each of their modules is for."""

Graph = dict[str, set[str]]


def modules() -> dict[str, Path]:
    """Every module of the house by its dotted name; a package is its __init__."""
    found = {}
    for room in ROOMS:
        for path in sorted((ROOT / room).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imported(path: Path, known: dict[str, Path]) -> Iterator[str]:
    """Modules of the house that a file imports anywhere; `from a import b` is a.b where that is a module."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively; write the whole name"
            base = node.module or ""
            for alias in node.names:
                full = f"{base}.{alias.name}"
                if full in known or base in known:
                    yield full if full in known else base


@pytest.fixture(scope="module")
def graph() -> Graph:
    known = modules()
    edges = {name: set(imported(path, known)) - {name} for name, path in known.items()}
    edges["strategies.registry"] |= {f"strategies.{name.replace('-', '_')}" for name in NAMES}  # imported by name
    return edges


def below(name: str, places: tuple[str, ...]) -> bool:
    """Whether a module is one of these places or inside one."""
    return any(name == place or name.startswith(place + ".") for place in places)


def circles(graph: Graph) -> list[frozenset[str]]:
    """Sets of modules that reach one another (Tarjan's strongly connected components of more than one)."""
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


def loads_by_name(path: Path) -> bool:
    """Whether a file can import what no import statement of it names."""
    tree = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    names = {getattr(node, key, "") for node in tree for key in ("id", "attr", "name")}
    return bool(names & {"import_module", "__import__", "find_spec", "run_module", "exec", "eval"})


def test_circles_are_seen() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a", "d2"}, "d2": set()}) == [frozenset("bc")]
    assert circles({"a": {"b"}, "b": set()}) == []


def test_the_graph_sees_imports_of_every_form(graph: Graph) -> None:
    assert len(graph) > 100
    assert "vehicle.world" in graph["strategies.timing"]  # at the top of a file
    assert "planner.planning" in graph["planner.commands.plan"]  # inside a function
    assert "reports.results" in graph["planner.commands.plan"]  # for type checking


def test_imports_by_name_are_all_in_the_graph(graph: Graph) -> None:
    assert {name for name, path in modules().items() if loads_by_name(path)} == BY_NAME
    # What `import planner` loads on demand stands there for type checking as well.
    assert {f"planner.{home}" for home in planner._HOMES} == graph["planner"]
    assert {name for names in planner._HOMES.values() for name in names} == set(planner.__all__)


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_knows_only_those_it_may(graph: Graph, room: str) -> None:
    strangers = {
        f"{name} -> {other}"
        for name, others in graph.items()
        if below(name, (room,))
        for other in others
        if not below(other, MAY_KNOW[room])
    }
    assert strangers == set()


def test_rooms_stand_in_one_order() -> None:
    for number, room in enumerate(ROOMS):
        assert {place.split(".")[0] for place in MAY_KNOW[room]} <= set(ROOMS[: number + 1])


def test_no_circle_of_files(graph: Graph) -> None:
    assert circles(graph) == []


def test_no_circle_of_packages_within_a_room(graph: Graph) -> None:
    packages = {room: {f"{room}.{path.parent.name}" for path in (ROOT / room).glob("*/__init__.py")} for room in ROOMS}

    def home(name: str) -> str:
        """The package inside a room that a module is in, or the module itself."""
        first = ".".join(name.split(".")[:2])
        return first if first in packages[name.split(".")[0]] else name

    edges: Graph = {home(name): set() for name in graph}
    for name, others in graph.items():
        edges[home(name)] |= {home(other) for other in others} - {home(name)}
    assert circles(edges) == []


def test_storeys_of_the_measured_stand_in_one_order(graph: Graph) -> None:
    level = {f"vehicle.measured.{storey}": number for number, storey in enumerate(STOREYS)}

    def storey(name: str) -> int | None:
        return level.get(".".join(name.split(".")[:3]))

    upwards = {
        f"{name} -> {other}"
        for name, others in graph.items()
        for other in others
        if (mine := storey(name)) is not None and (theirs := storey(other)) is not None and theirs > mine
    }
    assert upwards == set()
    assert {storey(name) for name in graph} >= set(range(len(STOREYS))), "a storey is gone; name those that are"


def test_the_vehicle_knows_nothing_of_what_is_measured_about_it(graph: Graph) -> None:
    inside, above = ("vehicle.measured",), ("vehicle.measured", "vehicle.trials", "vehicle.twin")
    wrong = {
        f"{name} -> {other}"
        for name, others in graph.items()
        if below(name, ("vehicle",)) and not below(name, above)
        for other in others
        if below(other, inside)
    }
    assert wrong == set()


def test_the_command_line_is_known_by_nobody(graph: Graph) -> None:
    wrong = {
        f"{name} -> {other}"
        for name, others in graph.items()
        if not below(name, COMMAND_LINE)
        for other in others
        if below(other, COMMAND_LINE)
    }
    assert wrong == set()


def test_the_service_is_known_by_its_own_commands_alone(graph: Graph) -> None:
    wrong = {
        f"{name} -> {other}"
        for name, others in graph.items()
        if not below(name, (*SERVICE, *OF_SERVICE))
        for other in others
        if below(other, SERVICE)
    }
    assert wrong == set()
    assert "planner.service.api" in graph["planner.commands.serve"]


def test_every_package_says_that_it_is_typed() -> None:
    packages = {path.parent for room in ROOMS for path in (ROOT / room).rglob("__init__.py")}
    assert {str(package.relative_to(ROOT)) for package in packages if not (package / "py.typed").is_file()} == set()
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert settings["tool"]["setuptools"]["package-data"]["*"] == ["py.typed"]


@pytest.mark.parametrize("package", MAPPED)
def test_the_map_of_a_room_names_every_module(package: str) -> None:
    folder = ROOT / package
    words = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))) or ""
    inside = {path.stem for path in folder.glob("[a-z]*.py")}
    inside |= {path.parent.name for path in folder.glob("*/__init__.py")}
    assert inside - {"errors"} - set(re.findall(r"\w+", words)) == set()
