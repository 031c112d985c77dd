"""`headland sweep`: thousands of combinations of options estimated, the best shown, any of them driven in full."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from planner.cli.common.options import (
    NO_RESULT_STATUS,
    ClusterOption,
    CsvOption,
    ExecutorChoice,
    FieldsArgument,
    ForceOutputOption,
    HeadlandOrderOption,
    JsonOption,
    ProcessesOption,
    expand_fields,
    get_option_name,
    in_computing,
    in_output,
    in_work,
    inject_request_options,
    is_web_address,
    read_given_options,
    render_refusal,
)
from planner.cli.common.outputs import (
    check_cache_folder,
    check_output_paths,
    list_input_files,
    write_before_printing,
)
from planner.cli.common.terminal import AnswerForm, print_renderable, warm_up
from planner.cli.plan import simulate_plans
from planner.errors import RequestError
from planner.pipeline.interrupts import is_interrupt, stop_repeating
from planner.request.options import PlanOption
from planner.request.plan_options import PLAN_OPTIONS
from planner.sweeps.axes import HEADLAND_ORDER, Axis, list_swept_options, read_axes

if TYPE_CHECKING:
    from planner.evaluation.work_order import WorkOrder
    from planner.pipeline.farm_inputs import GivenOptions
    from planner.sweeps.sweep import Sweep
    from reports.sweep.results import SweepResult, SweptPlan

BEST_EVERY_S = 2.0
SWEPT = {option.name: option for option in list_swept_options()}
_REPLACED = ("headland_first", "headland_last", "all", "strategies", "samples", "seed", "objective", "budget")
"""Options of a plan that a sweep takes in another way, or that change no estimate."""


def _format_default(value: Any) -> str | None:
    return None if value is None else f"{value:g}" if isinstance(value, int | float) else str(value)


CHANGES: dict[str, dict[str, Any]] = {
    name: {"type": str, "default": _format_default(option.default)}
    for name, option in SWEPT.items()
    if name != HEADLAND_ORDER.name
}
"""Options that may have several values are texts."""


@inject_request_options(without=_REPLACED, changes=CHANGES)
def sweep(
    context: typer.Context,
    fields: FieldsArgument = None,
    field_files: Annotated[
        Optional[list[str]], in_work("--fields", help="File of which all fields are swept, like FILE#*.")
    ] = None,
    headland_order: HeadlandOrderOption = None,
    html: Annotated[
        Optional[Path], in_output(help="Write one page with cost over time, what matters and the table.")
    ] = None,
    service: Annotated[
        str, in_output(help="Address of a service; the page links each combination to its form, filled in.")
    ] = "",
    png: Annotated[Optional[Path], in_output(help="Write the picture of cost over time.")] = None,
    parquet: Annotated[Optional[Path], in_output(help="Write all combinations as Parquet.")] = None,
    save: Annotated[
        Optional[Path], in_output(help="Drive one combination in full and write it, as headland plan --save.")
    ] = None,
    pick: Annotated[
        Optional[int],
        in_output(help="The row of the table to drive in full; with --save by default the one to take."),
    ] = None,
    force: ForceOutputOption = False,
    json: JsonOption = False,
    csv: CsvOption = False,
    processes: ProcessesOption = None,
    cluster: ClusterOption = None,
    cache: Annotated[
        Optional[Path], in_computing("--cache", help="Folder for what is estimated; it may be deleted at any time.")
    ] = None,
    **options: Any,
) -> None:
    """Estimate every combination of options with several values, and show those that no other beats.

    Numbers are 3,4.5,6 or a range 6:12:1 (from, to, step), tractors 1-8. Several fields are worked one after another.

    Example: headland sweep denmark --width 3,6 --speed-kmh 6:12:2 --tractors 1-4 --headland-order first,last
    """
    from reports.sweep.report import (
        build_sweep_screen,
        format_sweep_csv,
        format_sweep_json,
        render_sweep_page,
        render_sweep_parquet,
        render_sweep_png,
    )

    form, executor_choice = AnswerForm(json, csv), ExecutorChoice(processes, cluster)
    check_cache_folder(cache)
    question = _read_question(
        context, fields or (), field_files or (), {**options, HEADLAND_ORDER.name: headland_order}
    )
    if (save is not None or pick is not None) and len(question.fields) > 1:
        raise RequestError(f"--save and --pick are for one field, and {len(question.fields)} are given; give one.")
    check_output_paths(
        (html, ".html"),
        (png, ".png"),
        (parquet, ".parquet"),
        (save, ".json"),
        input_files=question.list_files(),
        force=force,
    )
    swept = question.build_sweep(question.build_link(service))
    with _show_what_is_done(swept, form):
        _run(swept, executor_choice, cache)
    result = swept.build_result()
    picked = pick_plan(result, pick) if save is not None or pick is not None else None
    with write_before_printing(
        (html, lambda: render_sweep_page(result)),
        (png, lambda: render_sweep_png(result)),
        (parquet, lambda: render_sweep_parquet(result)),
    ):
        form.print_answer(result, json=format_sweep_json, csv=format_sweep_csv, screen=build_sweep_screen)
    if picked is not None:
        order = swept.build_point_order(picked.numbers)
        _drive(order, result, picked, executor_choice, save, form.is_for_programs)
    if not result.has_recommendation:
        raise typer.Exit(NO_RESULT_STATUS)


def pick_plan(result: SweepResult, row: int | None) -> SweptPlan:
    """The plan of a row of the table, counted from 1; the best without a number. Raises RequestError."""
    rows = result.rows
    if not rows or result.best is None:
        raise RequestError("No combination has a plan, so none can be driven; vary other options.")
    if row is None:
        return result.best
    if not 1 <= row <= len(rows):
        raise RequestError(f"--pick is {row}; the table has rows 1 to {len(rows)}.")
    return rows[row - 1]


@dataclass(frozen=True)
class _Question:
    """What is asked of a sweep: its fields, its axes, and the options that stay."""

    given: GivenOptions
    fields: tuple[str, ...]
    axes: tuple[Axis, ...]

    def list_files(self) -> dict[str | Path, str]:
        """The files that any combination reads, and what they are."""
        found: dict[str | Path, str] = {}
        for name in self.fields:
            found |= list_input_files({**self.given.values, "field": name})
        for axis in self.axes:
            if axis.option.name in ("tractor", "soil"):
                for value in axis.values:
                    found |= list_input_files({axis.option.name: value})
        return found

    def build_sweep(self, link: str) -> Sweep:
        """The sweep over all combinations; without tractors among the options over those of the farm."""
        from planner.sweeps.sweep import Sweep
        from reports.sweep.results import list_option_words

        command = ["headland", "plan"]  # plans one combination, but for the field and the options that are varied
        for option, value in self._list_fixed():
            command += list_option_words(option.declaration or get_option_name(option.name), value)
        requests = {name: self.given.build_request(field=name) for name in self.fields}
        axes, given = self.axes, self.given
        if all(axis.parameter != "tractors" for axis in axes):
            counts = given.build_order(requests[self.fields[0]]).request.tractors
            axes = (*axes, *read_axes({"tractors": list(counts)}))
            given = replace(given, given_names={*given.given_names, "tractors"})

        def build_order(name: str, parameters: Mapping[str, Any]) -> WorkOrder:
            return given.build_order(replace(requests[name], **parameters))

        return Sweep(axes, self.fields, build_order, tuple(command), link)

    def build_link(self, service: str) -> str:
        """The form of a service at an address with the field and what stays; "" without one. Raises RequestError.

        Files go by the names that they have as uploads.
        """
        from reports.sweep.results import build_query

        if not service:
            return ""
        if not is_web_address(service) or any(mark in service for mark in "?#@"):
            raise RequestError(f"--service is {service[:80]!r}; give an address such as https://farm.example.")
        if len(self.fields) > 1:
            raise RequestError(f"--service is for one field, and {len(self.fields)} are given; give one.")
        name, mark, part = self.fields[0].partition("#")
        files = {one for one, path in self.given.values.items() if str(path) in map(str, self.list_files())}
        values = [(one.name, Path(value).stem if one.name in files else value) for one, value in self._list_fixed()]
        return f"{service.rstrip('/')}/#/plan?{build_query([('field', Path(name).stem + mark + part), *values])}"

    def _list_fixed(self) -> Iterator[tuple[PlanOption, Any]]:
        """The options that are given and stay, one that is repeated as often."""
        varied = {axis.option.name for axis in self.axes} | {"tractors"}
        for option in PLAN_OPTIONS:
            value = self.given.values.get(option.name)
            if option.name in varied or option.name not in self.given.given_names or value in (None, False):
                continue
            yield from ((option, one) for one in (value if isinstance(value, list | tuple) else [value]))


def _read_question(
    context: typer.Context, fields: Sequence[str], files: Sequence[str], options: Mapping[str, Any]
) -> _Question:
    """The question of the command line, with all fields of files; raises HeadlandError."""
    from fields.formats.features import ALL_FIELDS

    given = read_given_options(context, options)
    names = {name for name in given.given_names if options.get(name) is not None}
    read = read_axes({name: options[name] for name in SWEPT if name in names})
    axes = tuple(axis for axis in read if len(axis.values) > 1 or axis.parameter == "tractors")
    values = {**options, **{name: option.default for name, option in SWEPT.items() if name not in names}}
    values |= {axis.option.name: axis.written[0] for axis in read if axis.parameter != "tractors"}
    order = values.pop(HEADLAND_ORDER.name)
    if order is not None and all(axis.option is not HEADLAND_ORDER for axis in axes):
        values[f"headland_{order}"] = True
        names.add(f"headland_{order}")
    named = [*fields, *(file if "#" in file else f"{file}#{ALL_FIELDS}" for file in files)]
    return _Question(replace(given, values=values, given_names=names), expand_fields(named, options), axes)


def _run(swept: Sweep, executor_choice: ExecutorChoice, folder: Path | None) -> None:
    """Estimate what is not kept from an earlier run, with a bar that names the best so far."""
    from planner.cli.common.progress import open_stage_bar
    from planner.pipeline.result_cache import ResultCache, find_cache_folder
    from reports.sweep.results import describe_plan

    shown_s = 0.0

    def report(done: int, total: int) -> None:
        nonlocal shown_s
        bar.count(done, total)
        if time.monotonic() - shown_s > BEST_EVERY_S:
            result = swept.build_result()
            bar.show_work([] if result.best is None else [describe_plan(result, result.best)])
            shown_s = time.monotonic()

    cache = ResultCache(find_cache_folder() / "sweeps" if folder is None else folder)
    warm_up()
    is_remote = executor_choice.cluster is not None
    with (
        executor_choice.open_executor(swept.total) if is_remote else nullcontext() as executor,
        open_stage_bar("Estimating plans") as bar,
    ):
        bar.count(0, swept.total)
        swept.run(executor, cache, report, render_refusal, executor_choice.processes)
    if folder is None:
        cache.remove_oldest()


@contextmanager
def _show_what_is_done(swept: Sweep, form: AnswerForm) -> Iterator[None]:
    """After Ctrl-C print the combinations that are done; the interrupt goes on with a note that they are kept."""
    from reports.sweep.report import build_sweep_screen, format_sweep_csv, format_sweep_json

    try:
        yield
    except BaseException as error:
        if not is_interrupt(error):
            raise
        stop_repeating()
        result = swept.build_result()
        if result.plans:
            form.print_answer(result, json=format_sweep_json, csv=format_sweep_csv, screen=build_sweep_screen)
        goes_on = "; the same command goes on with it" if swept.done else ""
        error.add_note(f"{swept.done:,} of {swept.total:,} combinations{goes_on}; no file was written")
        raise


def _drive(
    order: WorkOrder,
    result: SweepResult,
    picked: SweptPlan,
    executor_choice: ExecutorChoice,
    save: Path | None,
    is_quiet: bool,
) -> None:
    """Plan a combination in full, write it, and print estimate and drive side by side."""
    from planner.pipeline.outputs.saved_plans import write_saved_plan
    from reports.sweep.results import compare_with_drive

    driven = simulate_plans(order, executor_choice, pictures=False)
    best = driven.ranking.best
    if best is None or driven.run is None:
        raise RequestError(f"This combination cannot be driven: {driven.ranking.refusal} Pick another row.")
    run = driven.run
    with write_before_printing((save, lambda: write_saved_plan(driven.context, run.plan, driven.ranking))):
        if not is_quiet:
            print_renderable(compare_with_drive, result, picked, best)
