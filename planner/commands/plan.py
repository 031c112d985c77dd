"""`headland plan`: from a field to ranked fleet plans."""

from __future__ import annotations

from dataclasses import fields as dataclass_fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner.commands.options import (
    Along,
    AsJson,
    Bearing,
    CellBearing,
    Corners,
    Crs,
    Entrance,
    FarmOption,
    FieldsArgument,
    Headland,
    HeadlandFirst,
    HeadlandLast,
    ImplementOption,
    Local,
    Margin,
    Operation,
    Swap,
    TracksOnly,
    TractorOption,
    Widths,
    shift_start,
    with_farm,
)
from strategies.names import NAMES

if TYPE_CHECKING:
    from planner.asked import Asked
    from planner.commands.many import Hands
    from planner.commands.outputs import Content
    from planner.planning import Planned
    from reports.results import Ranking

NO_PLAN_STATUS = 3
DEFAULT_FIELD = "iwamizawa"
RAIN = "When it begins to rain: 17:00, 16:30=20,17:00=50 (percent), 0.2/h (a rate) or a CSV of members (time, hours)."
KEEP = "Of many fields: keep answers in this .jsonl file as they are known; run again, what is in it is not redone."
REFILL = "Where a tank is filled or emptied: headland, tender or a place LON,LAT (X,Y with --local)."
BEFORE = "Deadline, hh:mm; not after the start: next day. Best is then the cheapest plan in time (late ground counts)."


def plan(
    context: typer.Context,
    fields: FieldsArgument = None,
    width: Widths = "3",
    tractors: Annotated[str, typer.Option(help="Tractor counts to try: 3, 1-6 or 1,3,5.")] = "1-6",
    strategies: Annotated[
        str,
        typer.Option(help=f"Strategies to try, separated by commas: {', '.join(NAMES)}; or all."),
    ] = "all",
    turn: Annotated[str, typer.Option(help="auto, u, omega or switch-back.")] = "auto",
    start: Annotated[Optional[str], typer.Option(help="Start of work, hh:mm.")] = None,  # noqa: UP045
    before: Annotated[Optional[str], typer.Option(help=BEFORE)] = None,  # noqa: UP045
    price_per_hour: Annotated[float, typer.Option(help="Price of one tractor for one hour.")] = 40.0,
    price_per_tractor: Annotated[float, typer.Option(help="Price of bringing one tractor.")] = 0.0,
    speed_kmh: Annotated[float, typer.Option(help="Working speed, km/h.")] = 5.0,
    turn_speed_kmh: Annotated[Optional[float], typer.Option(help="Turn speed, km/h; --speed-kmh, at most 5.")] = None,  # noqa: UP045
    headland: Headland = None,
    operation: Operation = "till",
    headland_first: HeadlandFirst = False,
    headland_last: HeadlandLast = False,
    corners: Corners = "square",
    tracks_only: TracksOnly = False,
    bearing: Bearing = None,
    cell_bearing: CellBearing = None,
    radius: Annotated[Optional[float], typer.Option(help="Turning radius to plan with, metres.")] = None,  # noqa: UP045
    clearance: Annotated[float, typer.Option(help="Least distance between machines with implements, metres.")] = 0.5,
    margin: Margin = 0.3,
    entrance: Entrance = None,
    tractor: TractorOption = "eg105",
    draws: Annotated[Optional[int], typer.Option(help="Draws of what varies; with --before or --rain 10000.")] = None,  # noqa: UP045
    rain: Annotated[Optional[str], typer.Option(help=RAIN)] = None,  # noqa: UP045
    refill: Annotated[Optional[str], typer.Option(help=REFILL)] = None,  # noqa: UP045
    prefer: Annotated[Optional[str], typer.Option(help="fastest, cheapest or surest: what the best plan is.")] = None,  # noqa: UP045
    budget: Annotated[Optional[float], typer.Option(help="Most that may be paid; no dearer plan is taken.")] = None,  # noqa: UP045
    farm: FarmOption = None,
    implement: ImplementOption = None,
    local: Local = False,
    crs: Crs = None,
    swap: Swap = False,
    along: Along = None,
    html: Annotated[Optional[Path], typer.Option(help="Write one page with map, bars and table.")] = None,  # noqa: UP045
    png: Annotated[Optional[Path], typer.Option(help="Write the map of the best plan.")] = None,  # noqa: UP045
    save: Annotated[Optional[Path], typer.Option(help="Write the legs and gates of the best plan as JSON.")] = None,  # noqa: UP045
    json: AsJson = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV instead of the table.")] = False,
    seed: Annotated[int, typer.Option(help="Seed; the same seed gives the same bytes.")] = 1,
    gnss: Annotated[bool, typer.Option("--gnss", help="Let positions err as an RTK receiver's do.")] = False,
    gnss_table: Annotated[Optional[str], typer.Option(help="The same by a table made with headland gnss fit.")] = None,  # noqa: UP045
    processes: Annotated[Optional[int], typer.Option(help="Processes to use; by default one per core.")] = None,  # noqa: UP045
    cluster: Annotated[Optional[str], typer.Option(help="Plan on a Dask cluster: tcp://HOST:8786.")] = None,  # noqa: UP045
    keep: Annotated[Optional[Path], typer.Option(help=KEEP)] = None,  # noqa: UP045
    full: Annotated[bool, typer.Option("--all", help="Simulate and show every plan, however slow.")] = False,
) -> None:
    """Simulate every combination of tractor count and strategy on a field and rank them.

    Example: headland plan myfarm.geojson --width 3 --tractors 1-6 --start 13:00 --before 17:00

    Many fields in one table: headland plan farm.geojson#* --width 3,6 --csv
    """
    from planner.commands.many import Hands, asking, plan_many
    from planner.commands.outputs import check_outputs, inputs, written
    from planner.commands.show import remark
    from planner.request import PlanRequest

    _one_output(json, csv)
    wanted, hands = asking(fields or [DEFAULT_FIELD], width, local, crs, swap), Hands(processes, cluster)
    request = PlanRequest(**{each.name: context.params[each.name] for each in dataclass_fields(PlanRequest)})
    scenario = request.scenario(wanted.fields[0], wanted.widths_m[0], None if before is None else shift_start(farm))
    if wanted.many or keep is not None:
        _of_one_field(("--html", html), ("--png", png), ("--save", save))
        ask = partial(with_farm, farm=farm, implement=implement, context=context)
        whole = plan_many(wanted, scenario, ask, hands, keep, json, csv, full)
        raise typer.Exit(0 if whole else NO_PLAN_STATUS)
    reads = inputs(field=wanted.fields[0], tractor=tractor, gnss_table=gnss_table, farm=farm, rain=rain)
    check_outputs((png, ".png"), (html, ".html"), (save, ""), reads=reads)
    planned = _planned(with_farm(scenario, farm, implement, context), hands, pictures=html is not None, every=full)
    remark([*planned.site.layout.field.remarks, *_learned(planned.ranking)])
    with written(_results(planned, html, png, save)):
        _print(planned.ranking, json, csv, full)
    _end(planned.ranking)


def _learned(ranking: Ranking) -> list[str]:
    """A sentence for every value that the farm's logs taught."""
    return [f"From the farm's own logs: {words}." for words in ranking.scenario.get("learned", ())]


def _end(ranking: Ranking) -> None:
    """End with the documented status where no plan meets what was asked."""
    if ranking.best is None or ranking.missed_by_s is not None or ranking.unmet is not None:
        raise typer.Exit(NO_PLAN_STATUS)


def _one_output(json: bool, csv: bool) -> None:
    from planner.errors import ScenarioError

    if json and csv:
        raise ScenarioError("--json and --csv both print to standard output; choose one.")


def _of_one_field(*outputs: tuple[str, Path | None]) -> None:
    """Refuse files that hold the plan of one field."""
    from planner.errors import ScenarioError

    for option, path in outputs:
        if path is not None:
            raise ScenarioError(f"{option} {path} is of one field and one width; name one, or use --csv or --json.")


def _planned(asked: Asked, hands: Hands, pictures: bool, every: bool) -> Planned:
    from planner.commands.show import progress_bar, warm_up
    from planner.planning import plan as simulate_all
    from planner.rank import candidates

    scenario = asked.scenario
    warm_up()
    with hands.executor(len(candidates(scenario))) as executor, progress_bar("Simulating plans") as progress:
        return simulate_all(
            scenario, tractor=asked.tractor, implement=asked.implement, chances=asked.chances, terms=asked.terms,
            supply=asked.supply, times=asked.times, yard=asked.yard, executor=executor, progress=progress,
            pictures=pictures, every=every,
        )  # fmt: skip


def _print(ranking: Ranking, json: bool, csv: bool, full: bool) -> None:
    if json or csv:
        from planner.commands.show import remark

        remark(ranking.day)
        from reports.export import ranking_csv, ranking_json

        typer.echo(ranking_json(ranking) if json else ranking_csv(ranking), nl=False)
        return
    from planner.commands.show import out
    from reports.table import ranking_table

    out(ranking_table(ranking, most=None if full else 20))


def _results(planned: Planned, html: Path | None, png: Path | None, save: Path | None) -> list[tuple[Path, Content]]:
    """Pictures and files of the best plan; says on standard error where it is none or late."""
    from reports.wording import closest, duration

    best, late = planned.ranking.best, planned.ranking.missed_by_s
    drive = None if best is None else planned.drives[best.strategy, best.tractors]
    results: list[tuple[Path, Content]] = []
    if late is not None:
        which = closest(planned.ranking)
        typer.echo(f"No plan meets the deadline; the {which} misses it by {duration(late)}.", err=True)
    elif planned.ranking.unmet is not None:
        typer.echo(planned.ranking.unmet, err=True)
    if drive is None and (html or png or save):
        typer.echo("No plan is feasible, so there is no map and no plan to save.", err=True)
    if html:
        from reports.page import plan_page

        results.append((html, plan_page(planned.ranking, drive, planned.drives)))
    if png and drive:
        from reports.figures import map_figure, png_bytes

        results.append((png, png_bytes(map_figure(drive, planned.ranking.field_name))))
    if save and planned.run:
        from planner.saving import saved_plan

        results.append((save, saved_plan(planned.site, planned.run.plan)))
    return results
