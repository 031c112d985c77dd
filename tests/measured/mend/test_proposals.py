"""What could lower the error further, on an open-loop error that is linear in two effects and curved in none."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from types import SimpleNamespace

import numpy as np
import pytest

from tests.measured.benches import eg105, knobs
from vehicle.measured.fit.openloop import Model, Term, fitted, held_out_loss
from vehicle.measured.mend.irreplaceable import irreplaceable
from vehicle.measured.mend.mending import Mended, beyond_tolerance, mend
from vehicle.measured.mend.proposals import best_pair, entry_of, proposals, simulated
from vehicle.measured.thresholds import WORTH

ROWS, RUNS = 240, 4


class LinearLoop:
    """Errors `base + sum(columns[id] * deviation)`; effects without a column change nothing."""

    def __init__(self, hidden: dict[str, float], noise: float = 0.02) -> None:
        rng = np.random.default_rng(4)
        self.columns = {name: rng.standard_normal(ROWS) for name in ("steering_offset", "implement_side_draft")}
        # A draft that undoes most of an offset: each alone explains little of the two together.
        own = self.columns["implement_side_draft"]
        self.columns["implement_side_draft"] = (self.columns["steering_offset"] + 0.4 * own) / 0.006
        base = -sum(self.columns[name] * value for name, value in hidden.items()) + noise * rng.standard_normal(ROWS)
        self.base = base / np.sqrt(float(base @ base))
        self.columns = {name: one / np.sqrt(float(base @ base)) for name, one in self.columns.items()}
        tractor = eg105()
        course = SimpleNamespace(places={})
        self.bench = SimpleNamespace(rig=SimpleNamespace(tractor=tractor), course=course, row_s=0.1)
        self.runs = np.arange(ROWS) * RUNS // ROWS
        self.settled: tuple[Term, ...] = ()

    def errors(self, terms: Sequence[Term]) -> np.ndarray:
        out = self.base.copy()
        for term in (*self.settled, *terms):
            if term.knobs.id in self.columns:
                out = out + self.columns[term.knobs.id] * term.knobs.deviation(term.at) * np.sign(term.at[0])
        return out

    def errors_of_each(self, each: Sequence[Sequence[Term]]) -> Iterator[np.ndarray]:
        return map(self.errors, each)

    def by_run(self, errors: np.ndarray) -> np.ndarray:
        return np.bincount(self.runs, errors * errors, RUNS)

    @cached_property
    def windows(self) -> np.ndarray:
        return np.arange(ROWS) * 2 * RUNS // ROWS

    @property
    def places(self) -> tuple[np.ndarray, np.ndarray]:
        return np.arange(2 * RUNS) // 2, np.arange(2 * RUNS) % 2


def nothing() -> None:
    """A step of progress."""


def test_an_effect_and_both_components_of_a_rest_enter_as_one() -> None:
    assert entry_of("push_to_east") == entry_of("push_to_north") == "push"
    assert entry_of("steering_offset") == "steering_offset" and entry_of("grip_by_speed") == "grip_by_speed"


def test_a_proposal_promises_what_least_squares_leaves() -> None:
    loop = LinearLoop({"steering_offset": 1.0})
    made = proposals(loop, fitted(loop, ()), eg105(), nothing)
    best = min(made, key=lambda one: one.loss)
    assert best.new[0].knobs.id == "steering_offset" and best.smooth
    column = loop.columns["steering_offset"]
    assert best.loss == pytest.approx(1.0 - float(column @ loop.base) ** 2 / float(column @ column), rel=1e-4)
    assert best.change == pytest.approx([-float(column @ loop.base) / float(column @ column)], rel=1e-4)
    assert all("grip_patch" != one.new[0].knobs.id != "grip_drift" for one in made)  # they would stand in for anything
    assert any(one.new[0].knobs.id == "push_to_east" and len(one.new) == 2 for one in made)


def test_proposals_are_simulated_and_the_best_comes_first() -> None:
    loop = LinearLoop({"steering_offset": 1.0})
    model = fitted(loop, ())
    made = proposals(loop, model, eg105(), nothing)
    (terms, loss), (_, next_loss), *_ = simulated(loop, model, made)
    assert terms[0].knobs.id == "steering_offset" and loss < 0.01 < next_loss
    assert terms[0].at == pytest.approx([1.0], abs=0.01)


def test_causes_that_mask_each_other_are_seen_as_a_pair() -> None:
    loop = LinearLoop({"steering_offset": 1.0, "implement_side_draft": -0.006})
    model = fitted(loop, ())
    made = proposals(loop, model, eg105(), nothing)
    ((terms, loss),) = best_pair(loop, model, made)
    assert {term.knobs.id for term in terms} == {"steering_offset", "implement_side_draft"} and loss < 0.1
    assert best_pair(loop, model, made[:1]) == []


def test_terms_enter_while_they_are_worth_it_and_stay_no_longer() -> None:
    loop = LinearLoop({"steering_offset": 1.0})
    made = mended(loop, ())
    assert made.model.ids == {"steering_offset"}
    assert made.model.loss < 1.0 - WORTH
    # Beside what was settled elsewhere only the rest of it enters, and as another effect it does not.
    assert mended(loop, (Term(knobs("steering_offset"), np.array([1.0])),)).model.ids == frozenset()


def mended(loop: LinearLoop, settled: tuple[Term, ...]) -> Mended:
    loop.settled = settled
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vehicle.measured.mend.mending.OpenLoop", lambda *given: loop)
        return mend(loop.bench, eg105(), settled, nothing)


def test_a_name_where_nothing_else_comes_near() -> None:
    loop = LinearLoop({"steering_offset": 1.0})
    model = fitted(loop, (Term(knobs("steering_offset"), np.array([0.0])),))
    assert irreplaceable(Mended(loop, model), eg105(), 0.0, nothing) == ["steering_offset"]
    # A twin that explains as much takes the name away.
    twin = LinearLoop({"steering_offset": 1.0})
    twin.columns["heading_bias"] = twin.columns["steering_offset"]
    assert irreplaceable(Mended(twin, fitted(twin, model.terms)), eg105(), 0.0, nothing) == []
    # So does noise that leaves as much as there is.
    assert irreplaceable(Mended(loop, model), eg105(), 1.0, nothing) == []


def test_what_mending_left_out_for_a_look_is_what_a_fit_without_it_leaves() -> None:
    loop = LinearLoop({"steering_offset": 1.0, "implement_side_draft": 0.01})
    made = mended(loop, ())
    assert len(made.model.ids) > 1 and set(made.smaller) == made.model.ids
    for name in made.model.ids:
        others = tuple(term for term in made.model.terms if term.knobs.id != name)
        alone, fresh = fitted(loop, others, 2), replace(made, smaller={}).without(name)
        assert made.without(name) is made.smaller[name]
        assert np.array_equal(made.without(name).errors, alone.errors) and np.array_equal(alone.errors, fresh.errors)
        assert np.array_equal(made.without(name).slope, alone.slope)


def test_a_rival_that_comes_near_before_it_is_fitted_is_not_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = LinearLoop({"steering_offset": 1.0})
    loop.columns["heading_bias"] = loop.columns["steering_offset"]
    made = mended(loop, ())
    monkeypatch.setattr("vehicle.measured.mend.irreplaceable.fitted", None)
    assert made.model.ids and irreplaceable(made, eg105(), 0.0, nothing) == []


def test_nothing_is_sought_for_what_others_come_near_without_or_what_does_not_hold(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    loop = LinearLoop({"steering_offset": 1.0})
    made, asked = mended(loop, ()), []
    monkeypatch.setattr("vehicle.measured.mend.irreplaceable.proposals", lambda *given: asked.append(given) or [])
    assert irreplaceable(made, eg105(), 0.0, nothing) == ["steering_offset"] and len(asked) == 1
    assert irreplaceable(made, eg105(), 0.0, nothing, lambda _: False) == []
    # Without the effect the others leave half as much again: clearly more than with it, yet any rival would be near.
    model = replace(made.model, errors=np.sqrt(0.2 / made.model.loss) * made.model.errors)
    half = replace(model, errors=np.sqrt(1.5) * model.errors)
    assert irreplaceable(replace(made, model=model, smaller={"steering_offset": half}), eg105(), 0.0, nothing) == []
    assert len(asked) == 1


def test_the_tolerance_of_the_file_and_times_of_it() -> None:
    loop = LinearLoop({})
    small = Term(knobs("steering_offset"), np.array([0.2]))  # its tolerance is 0.12
    assert beyond_tolerance(loop, small) and not beyond_tolerance(loop, small, 2.0)


def test_the_held_out_loss_of_one_coordinate_by_hand() -> None:
    loop = LinearLoop({"steering_offset": 1.0})
    model: Model = fitted(loop, (Term(knobs("steering_offset"), np.array([0.0])),))
    column, total = loop.columns["steering_offset"], 0.0
    for run in range(RUNS):
        mine, others = loop.runs == run, loop.runs != run
        at = -float(column[others] @ loop.base[others]) / float(column[others] @ column[others])
        total += float(np.sum((loop.base[mine] + column[mine] * at) ** 2))
    assert held_out_loss(loop, model) == pytest.approx(total, rel=1e-3)
