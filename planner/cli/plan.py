"""`headland plan`: from a field, or many fields and widths, to ranked fleet plans."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
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
    JsonOption,
    ProcessesOption,
    build_requests,
    in_computing,
    in_output,
    in_work,
    inject_request_options,
    read_given_options,
    render_refusal,
)
from planner.cli.common.outputs import check_output_paths, list_input_files, write_before_printing
from planner.cli.common.terminal import LOADING, AnswerForm, print_remarks, print_sentence, warm_up
from planner.errors import RequestError
from planner.request.plan_request import PlanRequest
from reports.common.language import mark_text

if TYPE_CHECKING:
    from planner.cli.common.progress import StageBar
    from planner.evaluation.work_order import WorkOrder
    from planner.pipeline.farm_inputs import GivenOptions
    from planner.pipeline.many_fields import Record
    from planner.pipeline.planning import PlanningResult
    from reports.common.plan_results import PlanRanking
    from reports.plan.comparison import ComparisonRow


_CHECKPOINT_HELP = "Of many fields: keep answers in this .jsonl file; a second run computes only what is missing in it."
_WIDTH = {
    "type": str,
    "default": "3",
    "help": "Working width of the implement, metres; 3,6 plans with both in one table.",
}


def plan_batch(
    requests: Sequence[PlanRequest],
    given: GivenOptions,
    executor_choice: ExecutorChoice,
    checkpoint: Path | None,
    html: Path | None,
    form: AnswerForm,
    force: bool,
) -> bool:
    """Print one table of every field at every width; whether each has a plan that meets the request.

    A page is written before the table is printed, and after all of the CSV.
    """
    from planner.cli.common.progress import open_stage_bar
    from planner.pipeline.many_fields import hash_order, read_answer_file, share_obstacles
    from reports.plan.many_fields import (
        build_many_fields_screen,
        build_many_fields_table,
        format_many_csv_head,
        format_many_fields_json,
        render_many_fields_page,
    )
    from reports.plan.shortfall_wording import question_pull

    check_output_paths(
        (checkpoint, ".jsonl"),
        (html, ".html"),
        force=force,
        updated=(checkpoint,),
        input_files={name.rpartition("#")[0] or name: "a field" for name in (one.field for one in requests)},
    )
    earlier_lines = {} if checkpoint is None else read_answer_file(checkpoint)
    orders = list(map(given.build_order, share_obstacles(requests)))
    keys, with_maps = list(map(hash_order, orders)), html is not None
    warm_up()
    if form.csv:
        typer.echo(format_many_csv_head(), nl=False)
    with open_stage_bar("Planning fields") as bar:
        show = _print_csv_rows if form.csv else lambda record: None
        records = _collect_records(orders, keys, executor_choice, checkpoint, earlier_lines, bar, show, with_maps)
        with write_before_printing((html, lambda: render_many_fields_page(records))):
            if not form.csv:
                form.print_answer(
                    records,
                    json=format_many_fields_json,
                    screen=build_many_fields_screen,
                    table=build_many_fields_table,
                )
    # Remarks on field files and machines, each once: with its field, unless it is said of several.
    fields_by_remark: dict[str, dict[str, None]] = {}
    for ranking in (record.ranking for record in records if record.ranking is not None):
        question = question_pull(ranking.pull) if form.is_for_programs else ""  # which tables say
        for text in filter(None, (*ranking.field_remarks, question)):
            fields_by_remark.setdefault(text, {})[ranking.field_name] = None
    print_remarks(
        text if len(fields) > 1 else f"{next(iter(fields))}: {text}" for text, fields in fields_by_remark.items()
    )
    return all(record.ranking is not None and record.ranking.is_recommended for record in records)


def _check_batch_options(
    png: Path | None, save: Path | None, done: Sequence[str] | None, checkpoint: Path | None
) -> None:
    """Raise RequestError for what only a plan of one field at one width can have."""
    for option, path in (("--png", png), ("--save", save)):
        if path is not None:
            raise RequestError(
                f"{option} {path} is for one field and one width; give only one, or use --html, --csv or --json."
            )
    if done and checkpoint is not None:
        raise RequestError(f"--checkpoint {checkpoint} is for many fields, and --done for one; leave out either.")
    if done:
        raise RequestError(f"--done {done[0]} is work of one field and one width; give only one of each.")


def _collect_records(
    orders: Sequence[WorkOrder],
    keys: Sequence[str],
    executor_choice: ExecutorChoice,
    checkpoint: Path | None,
    earlier_lines: Mapping[str, Record],
    bar: StageBar,
    print_record: Callable[[ComparisonRow], None],
    with_maps: bool,
) -> list[ComparisonRow]:
    """Answers as records in the sequence of the orders, each printed as soon as all before it are."""
    from planner.pipeline import many_fields as many

    finished: dict[int, ComparisonRow] = {}
    lines: dict[int, Record] = {}
    for index, key in enumerate(keys):
        if many.has_checksum(earlier_lines.get(key, {})):
            record = many.restore_record(earlier_lines[key])
            if not with_maps or record.best is None or record.map is not None:
                finished[index], lines[index] = record, earlier_lines[key]
    pending = [index for index in range(len(orders)) if index not in finished]
    printed_count = 0
    many.replace_records(checkpoint, earlier_lines.values())
    try:
        with executor_choice.open_executor(len(pending)) as executor:
            answers_by_position = many.iter_answers(
                executor, [orders[index] for index in pending], bar.show_work, render_refusal, with_maps=with_maps
            )
            while True:
                bar.count(len(finished), len(orders))
                while printed_count in finished:
                    print_record(finished[printed_count])
                    printed_count += 1
                position, answer = next(answers_by_position, (None, None))
                if position is None or answer is None:
                    break
                index = pending[position]
                finished[index] = answer
                lines[index] = many.save_record(keys[index], finished[index])
                many.append_record(checkpoint, lines[index])
    except BaseException as error:
        if checkpoint is not None:
            error.add_note(f"{len(finished)} of {len(orders)} answers are in {checkpoint}; nothing else was written")
        raise
    other_lines = [line for key, line in earlier_lines.items() if key not in set(keys)]
    many.replace_records(checkpoint, [*other_lines, *(lines[index] for index in sorted(lines))])
    return [finished[index] for index in range(len(orders))]


def _print_csv_rows(record: ComparisonRow) -> None:
    """Print the rows of a record at once."""
    from reports.plan.many_fields import format_many_csv_rows

    typer.echo(format_many_csv_rows(record), nl=False)
    sys.stdout.flush()


@inject_request_options(changes={"width": _WIDTH})
def plan(
    context: typer.Context,
    fields: FieldsArgument = None,
    html: Annotated[
        Optional[Path], in_output(help="Write one page with map, bars and table; of many fields one with all.")
    ] = None,
    done: Annotated[
        Optional[list[str]],
        in_work(
            help="Worked already: a file of ground, logs, or a saved plan at a time (plan.json@13:20), which goes on; "
            "once for each."
        ),
    ] = None,
    without: Annotated[
        Optional[list[int]],
        in_work(help="Leave out this machine of the plan that goes on, by its number; once for each."),
    ] = None,
    png: Annotated[Optional[Path], in_output(help="Write the map of the best plan.")] = None,
    save: Annotated[Optional[Path], in_output(help="Write the legs and gates of the best plan as JSON.")] = None,
    force: ForceOutputOption = False,
    explain: Annotated[
        bool, in_output("--explain", help="Print all plans, remarks, reasons, and how each figure is made up as well.")
    ] = False,
    json: JsonOption = False,
    csv: CsvOption = False,
    processes: ProcessesOption = None,
    cluster: ClusterOption = None,
    checkpoint: Annotated[Optional[Path], in_computing(help=_CHECKPOINT_HELP)] = None,
    **options: Any,
) -> None:
    """Simulate every combination of tractor count and strategy on a field and rank them.

    Example: headland plan myfarm.geojson --width 3 --tractors 1-6 --start 13:00 --deadline 17:00

    Many fields in one table: headland plan farm.geojson#* --width 3,6 --csv
    """
    from reports.plan.figures import format_ranking_csv, format_ranking_json
    from reports.plan.ranking_table import build_first_screen, build_ranking_table
    from strategies.registry import describe_hidden_strategies

    form, executor_choice = AnswerForm(json, csv, explain), ExecutorChoice(processes, cluster)
    given = read_given_options(context, options, done or (), without or ())
    request, *others = requests = build_requests(given, fields)
    if others or request.field != (fields or [request.field])[0] or checkpoint is not None:
        _check_batch_options(png, save, done, checkpoint)
        is_complete = plan_batch(requests, given, executor_choice, checkpoint, html, form, force)
        raise typer.Exit(0 if is_complete else NO_RESULT_STATUS)
    input_files = list_input_files({**options, "field": request.field})
    input_files |= {source.rpartition("@")[0] or source: "what is done" for source in done or ()}
    check_output_paths((png, ".png"), (html, ".html"), (save, ".json"), input_files=input_files, force=force)
    order = given.build_order(request)
    result = simulate_plans(order, executor_choice, pictures=html is not None)
    values = result.ranking.scenario.get("learned", ())
    learned = [mark_text(f"From the farm's own logs: {words}.") for words in values]
    print_remarks([*result.context.layout.field.remarks, *learned, *describe_hidden_strategies()])
    if form.is_for_programs or not sys.stdout.isatty():  # else the answer on the terminal says so
        _print_shortfalls(result.ranking)
    if result.ranking.best is None and (html or png or save):
        shown = mark_text("; the map shows the field and where plans fail") if html or png else ""
        print_sentence(f"No plan is feasible, so there is no plan to save{shown}.", err=True)
    files = result.get_view().files
    with write_before_printing(
        (html, files[".html"]), (png, files[".png"]), (save if result.run else None, files[".json"])
    ):
        if form.is_for_programs:
            print_remarks(result.ranking.day_sentences)
        form.print_answer(
            result.ranking,
            json=format_ranking_json,
            csv=format_ranking_csv,
            screen=partial(
                build_first_screen, shows_all=order.simulates_all, has_page=html is not None, has_plan=save is not None
            ),
            table=partial(build_ranking_table, most_plans=None if order.simulates_all else 20),
        )
    if not result.ranking.is_recommended:
        raise typer.Exit(NO_RESULT_STATUS)


def simulate_plans(order: WorkOrder, executor_choice: ExecutorChoice, pictures: bool) -> PlanningResult:
    """Simulate and rank the plans of an order, with a bar on a terminal."""
    from planner.cli.common.progress import open_stage_bar

    with open_stage_bar(LOADING) as bar, ExitStack() as opened:
        from planner.pipeline.planning import STAGES_S, plan_order
        from planner.pipeline.ranking import list_candidates
        from planner.pipeline.result_cache import NO_CACHE, ResultCache, find_cache_folder
        from planner.pipeline.worker_tasks import group_candidates

        warm_up(bar, STAGES_S)
        tasks = group_candidates(list_candidates(order.request))
        executor = opened.enter_context(executor_choice.open_executor(len(tasks)))
        return plan_order(
            order,
            executor=executor,
            report_stage=bar.report,
            with_pictures=pictures,
            cache=ResultCache(find_cache_folder() / "plans") if executor_choice.cluster is None else NO_CACHE,
        )


def _print_shortfalls(ranking: PlanRanking) -> None:
    """Print on standard error what the best plan lacks of what was asked for."""
    from reports.common.language import use_reader
    from reports.plan.shortfall_wording import list_shortfall_sentences

    with use_reader():
        sentences = list_shortfall_sentences(ranking)
    for sentence in sentences:
        print_sentence(sentence, err=True)
