"""`headland validate`: the experiments of the thesis, each number beside the printed one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner.commands.options import AsJson, Html

if TYPE_CHECKING:
    from planner.commands.outputs import Content
    from vehicle.trials.sheets.sheet import Sheet

Png = Annotated[Optional[Path], typer.Option(help="Write the pictures of one experiment.")]  # noqa: UP045


def validate(
    experiment: Annotated[
        Optional[str],  # noqa: UP045
        typer.Argument(help="circles, step, zigzag, navigation, fixed, changing, slip or twin; all when left out."),
    ] = None,
    html: Html = None,
    png: Png = None,
    seed: Annotated[int, typer.Option(help="Seed of the GNSS errors.")] = 1,
    json: AsJson = False,
) -> None:
    """Repeat the experiments of chapters 3 to 5 of the thesis and print every number beside the printed one.

    Example: headland validate zigzag --html zigzag.html
    """
    from planner.commands.outputs import check_outputs, written
    from planner.commands.show import out, progress_bar, warm_up
    from planner.errors import ScenarioError
    from vehicle.trials.sheets.catalogue import EXPERIMENTS, check_name
    from vehicle.trials.sheets.catalogue import validate as run

    check_outputs((html, ".html"), (png, ".png"))
    if experiment is not None:
        check_name(experiment, EXPERIMENTS, "experiment")
    elif png is not None:
        raise ScenarioError(f"--png shows one experiment; name one of: {', '.join(EXPERIMENTS)}.")
    if seed < 0:
        raise ScenarioError(f"--seed {seed} is negative; use 0 or more.")
    warm_up()
    with progress_bar("Running the experiments") as progress:
        names = EXPERIMENTS if experiment is None else (experiment,)
        sheets = run(names, seed=seed, progress=progress)
    with written(pictures(sheets, html, png)):
        if json:
            from reports.trials import trials_json

            typer.echo(trials_json(sheets), nl=False)
        else:
            from reports.trials import trials_table

            out(trials_table(sheets))


def pictures(sheets: tuple[Sheet, ...], html: Path | None, png: Path | None) -> list[tuple[Path, Content]]:
    """The page of some experiments and the picture of the first, where they were asked for."""
    results: list[tuple[Path, Content]] = []
    if html:
        from reports.trials import trials_page

        results.append((html, trials_page(sheets)))
    if png:
        from reports.figures import png_bytes
        from reports.trial_figures import sheet_figure

        results.append((png, png_bytes(sheet_figure(sheets[0]))))
    return results
