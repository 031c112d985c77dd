"""`headland diagnose`: what the simulation gets wrong in measured logs, why, and what mending it gains."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner.commands.options import AsJson, TractorOption

if TYPE_CHECKING:
    from planner.commands.outputs import Content
    from vehicle.measured.answer.demo import Hidden
    from vehicle.measured.answer.verdict import Diagnosis

Fixes = Annotated[
    Optional[list[str]],  # noqa: UP045 - typer reads this at run time
    typer.Option("--fix", help="A convention to convert from, such as steering-left-positive; can be given again."),
]
Ground = Annotated[str, typer.Option(help="Ground the logs were made on: soil or asphalt.")]


def diagnose(
    logs: Annotated[Optional[list[str]], typer.Argument(help="CSV or Parquet files, one run each.")] = None,  # noqa: UP045
    tractor: TractorOption = "eg105",
    ground: Ground = "soil",
    fix: Fixes = None,
    as_driven: Annotated[
        bool, typer.Option("--as-driven", help="Where the file is of another vehicle, take its size from the logs.")
    ] = False,
    demo: Annotated[bool, typer.Option("--demo", help="Hide an effect in made logs and find it.")] = False,
    seed: Annotated[Optional[int], typer.Option(help="Seed of the demonstration, 1 by default.")] = None,  # noqa: UP045
    hide: Annotated[Optional[str], typer.Option(help="Effect to hide in the demonstration; by default drawn.")] = None,  # noqa: UP045
    html: Annotated[Optional[Path], typer.Option(help="Write the report as one page.")] = None,  # noqa: UP045
    save: Annotated[Optional[Path], typer.Option(help="Write the tractor file with what was found.")] = None,  # noqa: UP045
    json: AsJson = False,
) -> None:
    """Compare the simulation with measured logs, name what it gets wrong, and extend the tractor file.

    Example: headland diagnose runs/*.csv --tractor eg105 --ground soil --html report.html --save my-eg105.toml
    """
    from planner.commands.single import one_thread

    one_thread()
    from planner.commands.outputs import check_outputs, inputs, written

    _check_demo(demo, logs, seed, hide, fix, as_driven)
    check_outputs((html, ".html"), (save, ".toml"), reads=inputs(logs=logs or (), tractor=tractor))
    found, hidden = _answer(logs, tractor, ground, fix, as_driven, 1 if seed is None else seed, hide)
    with written(_results(found, hidden, html, save)):
        _print(found, hidden, json)


def _results(
    found: Diagnosis, hidden: Hidden | None, html: Path | None, save: Path | None
) -> list[tuple[Path, Content]]:
    results: list[tuple[Path, Content]] = []
    if html:
        from reports.diagnosis_page import diagnosis_page

        results.append((html, diagnosis_page(found, None if hidden is None else hidden.words)))
    if save:
        from vehicle.measured.answer.save import tractor_toml

        results.append((save, tractor_toml(found.tractor)))
    return results


def _check_demo(
    demo: bool, logs: list[str] | None, seed: int | None, hide: str | None, fix: list[str] | None, as_driven: bool
) -> None:
    """Raise ScenarioError for both or neither of logs and demonstration, and for an option that would be ignored."""
    from planner.errors import ScenarioError

    if demo == bool(logs):
        raise ScenarioError("Give log files, or --demo for a demonstration; not both and not neither.")
    if demo and fix:
        raise ScenarioError("--fix converts log files; leave it out with --demo.")
    if demo and as_driven:
        raise ScenarioError("--as-driven takes a size from log files; leave it out with --demo.")
    for name, value in (("--seed", seed), ("--hide", hide)):
        if value is not None and not demo:
            raise ScenarioError(f"{name} {value} belongs to the demonstration; add --demo or leave {name} out.")


def _answer(
    logs: list[str] | None, tractor: str, ground: str, fix: list[str] | None, as_driven: bool, seed: int,
    hide: str | None,
) -> tuple[Diagnosis, Hidden | None]:  # fmt: skip
    """The diagnosis; without logs that of the demonstration, and what it had hidden."""
    from planner.commands.show import progress_bar
    from planner.diagnosis import demonstrate
    from planner.diagnosis import diagnose as explain

    with progress_bar("Diagnosing") as progress:
        if not logs:
            return demonstrate(tractor=tractor, ground=ground, seed=seed, hide=hide, progress=progress)
        found = explain(
            logs, tractor=tractor, ground=ground, fixes=fix or (), as_driven=as_driven, progress=progress
        )
        return found, None


def _print(found: Diagnosis, hidden: Hidden | None, json: bool) -> None:
    if json:
        from reports.diagnosis_export import diagnosis_json

        typer.echo(diagnosis_json(found, hidden), nl=False)
        return
    from planner.commands.show import out
    from reports.diagnosis_table import diagnosis_table

    out(diagnosis_table(found))
    if hidden is not None:
        from reports.effect_words import both
        from reports.fitting import sentence

        out(sentence(f"Hidden in these logs, which this simulator made itself: {both(hidden.id)}. {hidden.words}"))
