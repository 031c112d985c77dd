"""The trail of a diagnosis, from the scan to the verdict, and the picture of it in the guide.

    python -m tests.benchmarks.diagnosis_picture planner/guide/diagnosis-method.png --hide understeer --seed 1

The logs are those of `headland diagnose --demo`. Printed are the best of the first scan, every comparison, and values
with intervals; drawn are headings before and after in their noise, and predictive differences with standard errors.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fields.arrays import Floats
from vehicle.identification.diagnosis.corrections import correct_logs
from vehicle.identification.diagnosis.demo_logs import draw_hidden_effect, simulate_demo_logs
from vehicle.identification.diagnosis.drive_data import (
    POSE_CELL_S,
    POSE_CELLS,
    build_drive_data,
    choose_informative_parts,
)
from vehicle.identification.diagnosis.model_fit import Problem
from vehicle.identification.diagnosis.search import Judgement, Searcher, SearchResult
from vehicle.identification.diagnosis.verdicts import compute_interval, decide
from vehicle.identification.replay.drive_segments import build_dataset, build_rig
from vehicle.model.tractor import load_tractor

BAND_SIGMAS, GREY, BLUE, BAND = 2.0, "#6b7280", "#1d4ed8", "#dbe3f1"
HEADING = slice(2 * POSE_CELLS, None)  # of a window of poses


def search_causes(hide: str | None, seed: int) -> tuple[Problem, SearchResult, dict[str, Floats]]:
    """Search the causes in the logs of a demonstration as a diagnosis does, and print the trail."""
    tractor = load_tractor("eg105")
    hidden = draw_hidden_effect(seed, tractor, hide)
    logs = correct_logs(simulate_demo_logs(hidden, tractor, "soil", seed), tractor)
    dataset = build_dataset(logs, (tractor.antenna_forward_m, tractor.antenna_right_m))
    problem = Problem(build_drive_data(choose_informative_parts(dataset)), build_rig(tractor, "soil", dataset.origin))
    searcher = Searcher(problem)
    base, base_noise = searcher.fit_base(), problem.get_noise()
    print(f"hidden: {hidden.description}\n{problem.data.windows} windows; the first scan (nats, amount):")
    for gain in searcher.scan(base)[:5]:
        print(f"  {gain.hypothesis!s:40} {gain.nats:8.1f} {gain.amounts[0]:9.4f}")
    fit, judgements = searcher.settle(searcher.add_greedily(base))
    result = SearchResult(fit, base, tuple(judgements))
    print_verdicts(result, problem)
    return problem, result, base_noise


def print_verdicts(result: SearchResult, problem: Problem) -> None:
    """Print every comparison of the final model, and what follows."""
    for judgement in result.judgements:
        print(f"{judgement.hypothesis} (nats, z):")
        for one in (judgement.against_none, *judgement.against_others):
            print(f"  {one.alternative or 'nothing'!s:40} {one.nats:8.1f} {one.z:6.1f}")
    for verdict in decide(problem, result):
        interval = compute_interval(problem, verdict.hypothesis, verdict.amounts, verdict.covariance)
        print(f"{verdict.hypothesis}: {verdict.status} {verdict.amounts} {interval} {verdict.equivalent_to}")


def draw_headings(axes: Sequence[Any], problem: Problem, result: SearchResult, base_noise: dict[str, Floats]) -> None:
    """Draw the headings of the window with the largest ones, in the noise of each fit."""
    squares = (result.base.residuals["pose"][:, HEADING] ** 2).sum(axis=1)
    window, time = int(np.argmax(squares)), POSE_CELL_S * (np.arange(POSE_CELLS) + 0.5)
    fits = ("no cause", result.base, base_noise), ("the final model", result.fit, problem.get_noise())
    for axis, (words, fit, amounts) in zip(axes, fits, strict=True):
        covariance = np.tensordot(np.exp(amounts["pose"]), problem.noise["pose"].parts[:, window], axes=1)
        centre = np.eye(POSE_CELLS) - 1.0 / POSE_CELLS
        band = BAND_SIGMAS * np.asarray(np.degrees(np.sqrt(np.diag(centre @ covariance[HEADING, HEADING] @ centre))))
        axis.fill_between(time, -band, band, color=BAND, label=f"noise fitted beside it, {BAND_SIGMAS:g} sigma")
        axis.plot(time, np.degrees(fit.residuals["pose"][window, HEADING]), ".-", color=BLUE, label="residual")
        axis.set_title(f"Heading (deg) over 10 s, {words}", fontsize=9)
    axes[0].legend(fontsize=7, frameon=False)


def draw_differences(axis: Any, judgement: Judgement) -> None:
    """Draw a bar for every comparison of a hypothesis, with its standard error."""
    comparisons = judgement.against_none, *judgement.against_others
    places, nats = np.arange(len(comparisons))[::-1], np.array([one.nats for one in comparisons])
    errors = nats / np.array([one.z for one in comparisons])
    axis.barh(places, nats, xerr=errors, color=BLUE, ecolor=GREY, height=0.55, capsize=3)
    for place, one, end in zip(places, comparisons, np.maximum(nats, 0.0) + errors, strict=True):
        axis.text(end, place, f"  z = {one.z:.1f}", va="center", fontsize=8)
    axis.set_yticks(places, [str(one.alternative or "nothing").replace("@", "\n") for one in comparisons])
    axis.set_xlim(right=1.25 * float((nats + errors).max()))
    axis.set_title(f"{judgement.hypothesis} predicts better than ... (nats)", fontsize=9)


def main() -> None:
    """Run from the command line."""
    from matplotlib.figure import Figure

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--hide")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    problem, result, base_noise = search_causes(options.hide, options.seed)
    figure = Figure(figsize=(8.4, 3.7), layout="constrained")
    axes = figure.subplot_mosaic([["before", "bars"], ["after", "bars"]], width_ratios=(1.0, 1.1))
    draw_headings((axes["before"], axes["after"]), problem, result, base_noise)
    for judgement in result.judgements[:1]:
        draw_differences(axes["bars"], judgement)
    for axis in axes.values():
        axis.tick_params(labelsize=8)
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(options.file, dpi=120, metadata={"Software": None})


if __name__ == "__main__":
    main()
