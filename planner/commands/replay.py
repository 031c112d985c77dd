"""`headland replay`: one measured run against its simulation, as numbers and as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner.commands.diagnose import Fixes, Ground
from planner.commands.options import AsJson, TractorOption

if TYPE_CHECKING:
    from planner.commands.outputs import Content


def replay(
    log: Annotated[str, typer.Argument(help="A CSV or Parquet file with one run.")],
    tractor: TractorOption = "eg105",
    ground: Ground = "soil",
    fix: Fixes = None,
    png: Annotated[Optional[Path], typer.Option(help="Write the picture.")] = None,  # noqa: UP045
    html: Annotated[Optional[Path], typer.Option(help="Write the picture and the errors as one page.")] = None,  # noqa: UP045
    json: AsJson = False,
) -> None:
    """Replay the commands of a measured run, effects of the tractor file included, and compare with what was measured.

    Example: headland replay run.csv --tractor my-eg105.toml --png run.png
    """
    from planner.commands.single import one_thread

    one_thread()
    from planner.commands.outputs import check_outputs, inputs, written
    from planner.replaying import replay as simulate
    from reports.replay_report import replay_figure, replay_json, replay_page, replay_table

    check_outputs((png, ".png"), (html, ".html"), reads=inputs(logs=[log], tractor=tractor))
    answer = simulate(log, tractor=tractor, ground=ground, fixes=fix or ())
    results: list[tuple[Path, Content]] = []
    if png:
        from reports.figures import png_bytes

        results.append((png, png_bytes(replay_figure(answer.replayed))))
    if html:
        results.append((html, replay_page(answer.replayed, answer.remarks)))
    with written(results):
        if json:
            typer.echo(replay_json(answer.replayed, answer.remarks), nl=False)
        else:
            from planner.commands.show import out

            out(replay_table(answer.replayed, answer.remarks))
