"""`headland validate`: the experiments of the thesis, each number beside the printed one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner.commands.options import AsJson, check_output, write_text

if TYPE_CHECKING:
    from vehicle.trials.sheets.sheet import Sheet

Html = Annotated[Optional[Path], typer.Option(help="Write a page with pictures.")]  # noqa: UP045
Png = Annotated[Optional[Path], typer.Option(help="Write the pictures of one experiment.")]  # noqa: UP045


def validate(
    experiment: Annotated[
        Optional[str],  # noqa: UP045
        typer.Argument(help="circles, step, zigzag, navigation, fixed, changing or slip; all when left out."),
    ] = None,
    html: Html = None,
    png: Png = None,
    seed: Annotated[int, typer.Option(help="Seed of the GNSS errors.")] = 1,
    json: AsJson = False,
) -> None:
    """Repeat the experiments of chapters 3 and 4 of the thesis and print every number beside the printed one.

    Example: headland validate zigzag --html zigzag.html
    """
    from planner.commands.show import progress_bar, warm_up
    from planner.errors import ScenarioError
    from vehicle.trials.sheets.catalogue import EXPERIMENTS, check_name
    from vehicle.trials.sheets.catalogue import validate as run

    check_output(html, ".html")
    check_output(png, ".png")
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
    if json:
        from reports.trials import trials_json

        typer.echo(trials_json(sheets), nl=False)
    else:
        from planner.commands.show import out
        from reports.trials import trials_table

        out(trials_table(sheets))
    write_pictures(sheets, html, png)


def write_pictures(sheets: tuple[Sheet, ...], html: Path | None, png: Path | None) -> None:
    """Write the page of some experiments and the picture of the first."""
    if html:
        from reports.trials import trials_page

        write_text(html, trials_page(sheets))
    if png:
        from reports.figures import save_png
        from reports.trial_figures import sheet_figure

        save_png(sheet_figure(sheets[0]), png)
