"""Hypotheses against the formulas of the catalogue, and how their fields add up."""

from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest

from fields.arrays import Floats
from tests.identification.analytic_drives import rig, simulated
from vehicle.identification.diagnosis import grammar
from vehicle.identification.diagnosis.drive_data import build_drive_data
from vehicle.identification.diagnosis.grammar import (
    BY_DIRECTION,
    CONSTANT,
    WIDTH_PER_TYPICAL,
    Hypothesis,
    build_constant,
    build_scope,
    collect_widths,
    list_catalogue,
    list_competitors,
    list_laws,
    list_nuisances,
    sum_fields,
)
from vehicle.identification.diagnosis.model_fit import Problem, collect_bounds
from vehicle.identification.diagnosis.search import build_patch, list_circles
from vehicle.identification.diagnosis.verdicts import compute_values
from vehicle.identification.replay.simulation import CHAINS
from vehicle.model.effects import CATALOGUE, Effect, compute_effect_fields, get_effect


@lru_cache
def problem() -> Problem:
    return Problem(build_drive_data(simulated("circles", {})), rig())


def constant(name: str) -> Hypothesis:
    return build_constant(get_effect(name), problem().data, problem().rig.tractor)


def sum_of(*parts: tuple[Hypothesis, list[float]]) -> dict[str, Floats]:
    amounts = np.array([amount for _, own in parts for amount in own])
    return sum_fields([one for one, _ in parts], amounts, problem().bases, problem().simulator.base)


def test_every_effect_of_the_catalogue_has_a_hypothesis() -> None:
    known = list_catalogue(problem().data, problem().rig.tractor)
    assert sorted([*(one.id for one in known), "grip_patch"]) == sorted(effect.id for effect in CATALOGUE)
    fields = {name for one in known for name, _ in one.coordinates[0].slopes}
    assert fields <= {name for names in CHAINS.values() for name in names}


@pytest.mark.parametrize("name", [one.id for one in CATALOGUE if one.id not in ("grip_patch", "grip_drift")])
@pytest.mark.parametrize("share", [0.5, 1.0])
def test_the_fields_of_an_amount_are_those_of_its_values(name: str, share: float) -> None:
    """At a usual size, also of two coordinates together."""
    hypothesis = constant(name)
    signs = [-1.0 if one.high <= 0.0 else 1.0 for one in hypothesis.coordinates]
    amounts = share * np.array(signs) * collect_widths([hypothesis]) / WIDTH_PER_TYPICAL
    low, high = collect_bounds((hypothesis,))
    assert np.all((low <= amounts) & (amounts <= high))
    values = compute_values(problem(), hypothesis, amounts)
    known, neutral = compute_effect_fields({name: values}), compute_effect_fields({})
    shown = {key: array[0] for key, array in sum_of((hypothesis, list(amounts))).items()}
    assert shown == pytest.approx({key: known[key] for key in shown}, rel=1e-6)
    assert {key for key in known if known[key] != neutral.get(key)} == {*shown, "affected"}


def test_drift_and_circle_change_the_grip_as_their_formulas_do() -> None:
    minutes = problem().data.path["seconds"] / 60.0
    assert sum_of((constant("grip_drift"), [0.3]))["bend"] == pytest.approx(1.0 + 0.3 * minutes)
    circle = max(list_circles(problem().data), key=lambda one: problem().bases.find_circle(*one).mean())
    bend = sum_of((build_patch(circle), [-0.2]))["bend"]
    path = problem().data.path
    inside = np.hypot(path["east"] - circle[0], path["north"] - circle[1]) < circle[2]
    assert np.mean(bend == np.where(inside, 0.8, 1.0)) > 0.99  # centres are rounded to a centimetre


def test_factors_multiply_and_all_else_adds() -> None:
    gain, drift = constant("steering_gain"), constant("grip_drift")
    minutes = problem().data.path["seconds"] / 60.0
    assert sum_of((gain, [0.1]), (drift, [0.2]))["bend"] == pytest.approx(1.1 * (1.0 + 0.2 * minutes))
    latency, offset = constant("gnss_latency"), constant("steering_offset")
    lateness = next(one for one in list_nuisances(problem().data) if one.id == "_lateness")
    assert sum_of((latency, [0.1]), (lateness, [1.5]))["latency"] == pytest.approx(7.5)
    run = build_scope(offset, "by_side:left")
    left = problem().bases.get("by_side:left")
    assert sum_of((offset, [1.0]), (run, [0.5]))["offset"] == pytest.approx(np.radians(1.0 + 0.5 * left))
    assert sum_of((offset, [0.0])) == {}


def test_an_effect_of_each_run_acts_in_its_run() -> None:
    gain, bases = constant("steering_gain"), problem().bases
    (law,) = [one for one in list_laws(gain, bases) if one.law == "by_run"]
    bend = sum_of((law, [0.1, -0.2]))["bend"]
    assert bend == pytest.approx(np.where(problem().data.path_runs == 0, 1.1, 0.8))


@pytest.mark.parametrize("effect", [one for one in CATALOGUE if one.same_law], ids=lambda one: one.id)
def test_a_law_that_an_effect_is_the_same_as_is_not_tried(effect: Effect, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the effect it would be."""
    name, _, basis = effect.same_law.partition("@")
    bases = SimpleNamespace(data=problem().data, arrays={basis: np.linspace(0.0, 1.0, 9)}, has_directions=False)
    assert basis in problem().bases.arrays or basis == "by_implement"  # which drives in circles have none of
    assert basis not in [one.coordinates[0].basis for one in list_laws(constant(name), bases)]  # type: ignore[arg-type]
    monkeypatch.setattr(grammar, "CATALOGUE", ())
    assert basis in [one.coordinates[0].basis for one in list_laws(constant(name), bases)]  # type: ignore[arg-type]


def test_no_two_hypotheses_have_one_name() -> None:
    data, tractor = problem().data, problem().rig.tractor
    every = [*list_catalogue(data, tractor), *list_competitors(data, tractor, problem().bases), *list_nuisances(data)]
    assert len({str(one) for one in every}) == len(every)
    assert all(one.chains and np.all(collect_widths([one]) > 0.0) for one in every)


def test_a_law_by_direction_needs_several_directions() -> None:
    """Of one direction only the noise of the heading is left, which such a law would explain."""
    own = Problem(build_drive_data(simulated("circles", {})), rig())
    assert BY_DIRECTION in {one.law for one in list_laws(constant("heading_bias"), own.bases)}
    heading = 0.3 + 0.01 * np.random.default_rng(1).standard_normal(len(own.bases.get(CONSTANT)))
    own.bases.arrays |= {"to_east": np.cos(heading), "to_north": np.sin(heading)}
    hypotheses = list_competitors(own.data, own.rig.tractor, own.bases)
    assert not any(one.law == BY_DIRECTION for one in hypotheses)
