"""Options that several commands share: those of a plan request, taken from its model, and a few more."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional, get_type_hints

import typer
from typer.models import ArgumentInfo

from planner.cli.common.outputs import check_output_paths, write_before_printing
from planner.cli.common.terminal import print_remarks, print_sentence
from planner.errors import HeadlandError, RequestError, strip_unit
from planner.request.option_texts import parse_widths
from planner.request.plan_options import PLAN_OPTIONS
from planner.request.plan_request import COMPUTING, OUTPUT, WORK, PlanRequest

if TYPE_CHECKING:
    from planner.pipeline.farm_inputs import GivenOptions


in_output, in_work, in_computing = (
    functools.partial(typer.Option, rich_help_panel=panel) for panel in (OUTPUT, WORK, COMPUTING)
)
"""Options of a plan by their panel in its help."""
JsonOption = Annotated[bool, in_output("--json", help="Print JSON for programs instead of the table.")]
CsvOption = Annotated[bool, in_output("--csv", help="Print CSV instead of the table.")]
ProcessesOption = Annotated[Optional[int], in_computing(help="Processes to use; by default one per core.")]
ClusterOption = Annotated[Optional[str], in_computing(help="Plan on a Dask cluster: tcp://HOST:8786.")]
FIELD_FORMS = "GeoJSON, Shapefile, KML, GeoPackage, GPX, ISOXML, AgOpenGPS"
SAMPLES = "iwamizawa, denmark, netherlands, sweden"
FieldArgument = Annotated[
    str,
    typer.Argument(help=f"A field file ({FIELD_FORMS}; file#ID picks one of several parcels) or a sample: {SAMPLES}."),
]
FieldsArgument = Annotated[
    Optional[list[str]],
    typer.Argument(
        help=f"Field files ({FIELD_FORMS}; file#ID picks one of several parcels, #* all of them) or samples: "
        f"{SAMPLES}.",
        show_default="iwamizawa",
    ),
]
DEFAULT_FIELD = PlanRequest.field
NO_RESULT_STATUS = 3
"""Exit status where no plan meets the request, and where a diagnosis has nothing to save."""
_HELP_TEXTS = {option.name: option.help for option in PLAN_OPTIONS}
TractorOption = Annotated[str, typer.Option("--tractor", help=_HELP_TEXTS["tractor"])]
HeadlandOrderOption = Annotated[
    Optional[str], in_work(help="When the headland is worked: first, last. By default what --operation allows.")
]
FarmOption = Annotated[Optional[str], typer.Option("--farm", help=_HELP_TEXTS["farm"])]
PlanArgument = Annotated[Path, typer.Argument(help="A plan written by headland plan --save.")]
RunsArgument = Annotated[list[Path], typer.Argument(help="The folder of headland logs import, or log files in it.")]
FORCE_HELP = "Overwrite files that are no earlier pages, pictures or plans of Headland."
ForceOption = Annotated[bool, typer.Option("--force", help=FORCE_HELP)]
ForceOutputOption = Annotated[bool, in_output("--force", help=FORCE_HELP)]
Html = Annotated[Optional[Path], typer.Option(help="Write a page with pictures.")]
Png = Annotated[Optional[Path], typer.Option(help="Write the pictures.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for programs instead of the table.")]


_OPTION_NAMES = {
    "field": "the field",
    "headland_order": "--headland-first or --headland-last",
    "list_fields": strip_unit("list_fields"),
    "mapping": "--column",
}


def get_option_name(parameter: str) -> str:
    """What a parameter of a program is called on the command line: width_m is --width, speed_mps is --speed-kmh."""
    return _OPTION_NAMES.get(parameter) or "--" + strip_unit(parameter).replace("_", "-")


def create_group(help_text: str, **options: Any) -> typer.Typer:
    """A group of commands, also where it has only one; without a command it prints its help."""
    group = typer.Typer(help=help_text, no_args_is_help=True, **options)
    group.callback()(lambda: None)
    return group


def add_example_commands(group: typer.Typer, kind: str, describe_next: Callable[[Path], str]) -> None:
    """Give a group the commands that write and print the example of its kind of file, "farm" or "day".

    `describe_next` says that it was written and what to do with it.
    """
    place = typer.Argument(help=f"The file to write, such as {kind}.toml.")

    def read_text() -> str:
        from planner.farm.settings import read_example_text

        return read_example_text(kind)

    def write_example(file: Path = place, force: ForceOption = False) -> None:
        check_output_paths((file, ".toml"), force=force)
        with write_before_printing((file, read_text())):
            print_sentence(describe_next(file))

    group.command(
        "new", help=f"Write an example of a {kind} file, to be adapted.\n\nExample: headland {kind} new {kind}.toml"
    )(write_example)
    group.command(
        "example", help=f"Print the example of a {kind} file.\n\nExample: headland {kind} example > {kind}.toml"
    )(lambda: typer.echo(read_text(), nl=False))


def is_web_address(text: str) -> bool:
    """Whether a text is the address of a service: http or https, a host, and perhaps a port."""
    from urllib.parse import urlsplit

    try:
        parts = urlsplit(text)
        is_address = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:  # such as half an IPv6 address
        return False
    return is_address and " " not in text and text.isprintable()


def render_refusal(refusal: HeadlandError) -> str:
    """The sentence of a refusal with the names of options."""
    return refusal.render_sentence(get_option_name)


@dataclass(frozen=True)
class ExecutorChoice:
    """Where to compute: in processes of this machine, or on a cluster; raises RequestError for both."""

    processes: int | None
    cluster: str | None = None

    def __post_init__(self) -> None:
        if self.processes is not None and self.processes < 1:
            raise RequestError(f"--processes is {self.processes}; use 1 or more.")
        if self.processes is not None and self.cluster is not None:
            raise RequestError("--processes is for this machine, --cluster for others; leave out one of them.")

    def open_executor(self, tasks: int) -> AbstractContextManager[Executor]:
        """The executor for this number of tasks."""
        from planner.pipeline.executors import connect_cluster, create_executor

        return create_executor(tasks, self.processes) if self.cluster is None else connect_cluster(self.cluster)


def inject_request_options(
    *,
    only: Collection[str] | None = None,
    without: Collection[str] = (),
    panels: bool = True,
    changes: Mapping[str, Mapping[str, Any]] | None = None,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the options of a plan request and its farm in place of its `**options`; a decorator.

    They stand between the arguments of the command and its own options: all of them but the field and those `without`,
    or `only` some by name. `changes` are of what the command takes in another way, by name.
    """

    def extend(command: Callable[..., None]) -> Callable[..., None]:
        hints = get_type_hints(command, include_extras=True)
        own = [
            parameter.replace(annotation=hints[name])
            for name, parameter in inspect.signature(command).parameters.items()
            if parameter.kind is not inspect.Parameter.VAR_KEYWORD
        ]
        taken = []
        for option in PLAN_OPTIONS:
            if option.name in ("field", *without) or (only is not None and option.name not in only):
                continue
            other = (changes or {}).get(option.name, {})
            kind, default = other.get("type", option.type), other.get("default", option.default)
            info = typer.Option(
                option.declaration or get_option_name(option.name),
                help=other.get("help", option.format_help(get_option_name)),
                rich_help_panel=option.panel if panels else None,
            )
            kind = kind if default is not None else Optional[kind]
            by_name = inspect.Parameter.KEYWORD_ONLY
            taken.append(inspect.Parameter(option.name, by_name, default=default, annotation=Annotated[kind, info]))
        first = [
            parameter
            for parameter in own
            if parameter.annotation is typer.Context
            or any(isinstance(part, ArgumentInfo) for part in getattr(parameter.annotation, "__metadata__", ()))
        ]
        last = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in own if parameter not in first]

        @functools.wraps(command)
        def run(*arguments: Any, **options: Any) -> None:
            command(*arguments, **options)

        run.__signature__ = inspect.Signature([*first, *taken, *last])  # type: ignore[attr-defined]
        return run

    return extend


def read_given_options(
    context: typer.Context, values: Mapping[str, Any], done: Sequence[str] = (), without: Sequence[int] = ()
) -> GivenOptions:
    """The options of a plan as a command was given them, and the farm that they name; raises RequestError.

    `done` is what is worked already, `without` the machines that do not go on.
    """
    from planner.pipeline.farm_inputs import GivenOptions

    sources = {name: context.get_parameter_source(name) for name in context.params}
    names = [name for name, source in sources.items() if source and source.name != "DEFAULT"]
    return GivenOptions(values, names, tuple(done), tuple(without))


def expand_fields(fields: Sequence[str], options: Mapping[str, Any]) -> tuple[str, ...]:
    """The named fields, with stars for all of a file, which is read as options say; raises HeadlandError."""
    from planner.pipeline.many_fields import expand_field_names

    reading = {name: options[name] for name in ("local", "crs", "swap_axes")}
    return expand_field_names(fields or [DEFAULT_FIELD], **reading, show_remarks=print_remarks)


def build_requests(given: GivenOptions, fields: Sequence[str] | None) -> list[PlanRequest]:
    """A request for each of the named fields, with or without stars, at every width; raises HeadlandError."""
    names, remarks = expand_fields(fields or (), given.values), list[str]()
    widths_m = parse_widths(given.values["width"], remarks.append)
    requests = [given.build_request(field=name, width=width_m) for name in names for width_m in widths_m]
    print_remarks(remarks)
    return requests
