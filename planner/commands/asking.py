"""Questions on a terminal about what a command was not given."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from vehicle.datasheet.sheet import Quantity


def may_ask() -> bool:
    """Whether somebody is there to answer."""
    return sys.stdin is not None and sys.stdin.isatty() and sys.stderr is not None and sys.stderr.isatty()


def ask_missing(name: str | None, given: dict[str, float | str | None]) -> str:
    """Ask for the name and for every needed value that is None, and fill them into `given`."""
    from vehicle.datasheet import NEEDED, QUANTITIES

    try:
        if name is None:
            name = str(typer.prompt("Name of the tractor", err=True))
        for key in NEEDED:
            if given[key] is None:
                given[key] = _number(QUANTITIES[key])
    except typer.Abort:
        typer.echo(err=True)  # ends the line of the question
        raise KeyboardInterrupt from None
    return name


def _number(quantity: Quantity) -> float:
    """Ask until the answer is a number that can be."""
    question = f"{quantity.words[0].upper()}{quantity.words[1:]}, {quantity.unit}"
    hint = f"usually {quantity.usual_low:g} to {quantity.usual_high:g}, such as {quantity.usual:g}"
    while True:
        answer = str(typer.prompt(f"{question} ({hint})", err=True))
        try:
            value = float(answer.strip().removesuffix(quantity.unit).strip().replace(",", "."))
        except ValueError:
            typer.echo(f"{answer.strip()!r} is no number; write for instance {quantity.usual:g}.", err=True)
            continue
        if quantity.low <= value <= quantity.high:
            return value
        typer.echo(f"{value:g} is not possible; use {quantity.low:g} to {quantity.high:g}.", err=True)
