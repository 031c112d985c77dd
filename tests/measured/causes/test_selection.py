"""Choosing causes: what the simulator drove is chosen and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from tests.measured.benches import bench_of, eg105, knobs, linear_bench
from vehicle.measured.causes import selection
from vehicle.measured.causes.evidence import promised_costs
from vehicle.measured.causes.known import Known
from vehicle.measured.causes.refit import enlarged, restarted, retuned, without
from vehicle.measured.causes.selection import _rank, ended, pruned, scan, select
from vehicle.measured.causes.trial import Projector, Tried, tried
from vehicle.measured.fit.fitting import empty_fit, refined
from vehicle.measured.surprise.bench import Bench, prepare
from vehicle.measured.surprise.noise import first_noise
from vehicle.measured.thresholds import EASING, LEAST_GAIN, MOST_EASINGS, PATCH_HANDICAP, WRONG_EVERYWHERE


@pytest.fixture(scope="module")
def bench() -> Bench:
    return bench_of("circles", {"steering_offset": {"angle_deg": 1.0}})


def gained(name: str, gain: float) -> Tried:
    return Tried(knobs(name), np.zeros(1), gain, np.zeros((1, 1)))


def test_a_circle_must_gain_clearly_more_than_a_plain_effect() -> None:
    as_good = PATCH_HANDICAP * (100.0 + LEAST_GAIN)
    plain = gained("steering_offset", 100.0)
    assert _rank(gained("grip_patch", as_good + 1.0)) < _rank(plain) < _rank(gained("grip_patch", as_good - 1.0))


def test_the_hidden_effect_is_first_and_alone(bench: Bench) -> None:
    chosen = select(bench, eg105())
    assert chosen.ids == {"steering_offset"} and chosen.unnamed == ()
    assert float(chosen.fit.parts[0][1][0]) == pytest.approx(1.0, abs=0.02)
    best = scan(bench, empty_fit(bench), eg105(), {"steering_offset"}).candidates
    assert all(one.knobs.id != "steering_offset" for one in best)
    assert [one.gain for one in best if one.knobs.id != "grip_patch"] == sorted(
        (one.gain for one in best if one.knobs.id != "grip_patch"), reverse=True
    )


def test_candidates_that_were_only_begun_are_tried_to_their_end_when_asked(bench: Bench) -> None:
    fit = empty_fit(bench)
    # The scan before told that the offset is the best, but of a path that was otherwise.
    before = Known(fit, Projector(fit.slope), fit.surprise + 1.0, [gained("steering_offset", 100.0)], [])
    known = scan(bench, fit, eg105(), set(), known=before)
    found = known.candidates
    assert found[0].knobs.id == "steering_offset" and found[0].ended
    assert {one.knobs.id for one in found if not one.ended}, "others promise something, far less than the offset gains"
    whole = ended(bench, known, found)
    assert all(one.ended for one in whole) and whole[0].knobs.id == "steering_offset"
    gains = {one.knobs.id: one.gain for one in found}
    assert all(one.gain >= gains[one.knobs.id] - 1e-9 for one in whole)
    assert any(one.gain > gains[one.knobs.id] + LEAST_GAIN for one in whole)
    for one in whole:  # what was begun is gone on with, to where a trial of its own comes
        alone = tried(bench.changes, fit, one.knobs, known.project)
        assert one.gain == alone.gain and np.array_equal(one.at, alone.at)
        assert np.array_equal(one.columns, alone.columns)


def test_a_plain_cause_is_not_fitted_away(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a straight line promises is what a fit without the part comes to, where it is linear."""
    parts = ((knobs("steering_offset"), np.array([1.0])), (knobs("heading_bias"), np.array([0.0])))
    fit = refined(bench, restarted(bench, parts, None))
    costs = promised_costs(fit)
    assert costs["steering_offset"] > LEAST_GAIN > costs["heading_bias"] >= 0.0
    come_back = without(bench, fit, "steering_offset").loss - fit.loss
    assert costs["steering_offset"] == pytest.approx(come_back, rel=0.2)
    alone = without(bench, fit, "heading_bias")
    monkeypatch.setattr(selection, "PLAINLY", 2.0)
    monkeypatch.setattr(selection, "without", None)
    assert pruned(bench, alone) is alone, "nothing was fitted"


def test_what_the_others_make_superfluous_is_left_out(bench: Bench) -> None:
    parts = ((knobs("steering_offset"), np.array([1.0])), (knobs("heading_bias"), np.array([0.0])))
    fit = refined(bench, restarted(bench, parts, None))
    assert [one.id for one, _ in pruned(bench, fit).parts] == ["steering_offset"]
    rest = without(bench, fit, "steering_offset")
    assert [one.id for one, _ in rest.parts] == ["heading_bias"] and rest.loss > fit.loss + LEAST_GAIN


def test_a_part_enters_with_the_coordinates_it_was_tried_at(bench: Bench) -> None:
    start = empty_fit(bench)
    larger = enlarged(bench, start, Tried(knobs("steering_offset"), np.array([1.0]), 0.0, np.zeros((1, 1))))
    assert larger.settings == {"steering_offset": {"angle_deg": 1.0}}
    assert larger.surprise == pytest.approx(bench.surprise(larger.settings))


def test_a_model_that_is_wrong_everywhere_is_judged_by_longer_ways() -> None:
    """A tractor that turns 3 % less than its file: positions and headings are trusted less until it can pass."""
    wrong = bench_of("circles", {"steering_gain": {"ratio": 0.97}})
    eased = retuned(wrong, empty_fit(wrong))
    plain = first_noise(wrong.course)
    easings = np.log(eased.noise.position / plain.position) / np.log(EASING)
    assert easings == pytest.approx(round(easings)) and 1 <= round(easings) <= MOST_EASINGS
    assert eased.noise.heading / plain.heading == pytest.approx(eased.noise.position / plain.position)
    path = eased.path_surprise(eased.path({}), {})
    assert float(np.mean(path * path)) < WRONG_EVERYWHERE
    # Only what is eased is weighed again, and is as if all had been.
    anew = prepare(wrong.course, wrong.rig, {}, eased.noise)
    for one, other in zip(eased.filters, anew.filters, strict=True):
        assert np.array_equal(one.gains, other.gains) and np.array_equal(one.roots, other.roots)
    assert np.array_equal(anew.surprise({}), eased.surprise({}))


def test_a_part_is_not_left_out_because_the_others_had_not_come_to_their_best() -> None:
    """The heading bias is off by 2: without the offset it alone comes to its best, which leaves less than before."""
    bench = linear_bench(steering_offset=1.0, heading_bias=1.0)
    parts = ((knobs("steering_offset"), np.array([1.0])), (knobs("heading_bias"), np.array([3.0])))
    fit = replace(bench.fit("steering_offset", "heading_bias"), parts=parts,
                  surprise=bench.surprise({one.id: one.values(at) for one, at in parts}))  # fmt: skip
    assert set(pruned(bench, fit).settings) == {"steering_offset", "heading_bias"}


def test_nothing_is_settled_while_a_candidate_was_only_begun(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """One is clear that no longer is when others are looked at: all are tried before it is said that none is."""
    looked, known = list[list[Tried]](), scan(bench, restarted(bench, (), None), eg105(), set())
    first, clear, *others = known.candidates
    foreseen = [replace(one, ended=False, foreseen=0.0) for one in others]
    begun = replace(known, candidates=[first, replace(clear, gain=2.0 * LEAST_GAIN), *foreseen])

    def strengths(_: Bench, candidates: list[Tried], left: object) -> tuple[list[float], float]:
        looked.append(candidates)
        return [0.0, *(1e6 for _ in candidates[1:])], 0.0 if len(looked) == 1 else 1e9

    monkeypatch.setattr(selection, "strengths", strengths)
    monkeypatch.setattr(selection, "scan", lambda *_: begun)
    monkeypatch.setattr(selection, "_rival", lambda *_: None)
    chosen = selection._forward(selection.Selection(bench, known.fit, (), 0.0), eg105(), set(), None)
    assert not chosen.fit.parts and len(looked) == 3
    assert all(one.ended for one in looked[-1]) and not all(one.ended for one in looked[0])
