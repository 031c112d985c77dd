"""A gain that vanishes by a law is no wheel that stops following; one that vanishes at once, in one run, is."""

import numpy as np
import pytest

from tests.truth.cases import Law, TruthCase
from tests.truth.third import make_third_logs
from vehicle.identification.faults.steering_faults import mark_steering_faults
from vehicle.identification.faults.vanishing_gain import PathShares, PathSpan, find_spans_by_law
from vehicle.identification.logs.reader import build_log

BLOCKS, STEPS = 50, 10
LAWS = {
    "north": Law("steering_gain", "by_place", {"at_origin": 0.8, "per_m_east": 0.0, "per_m_north": 0.05}),
    "minutes": Law("steering_gain", "over_minutes", {"start": 1.0, "per_minute": -1.1}),
    "angle": Law("steering_gain", "by_angle", {"at_0": 1.0, "at_27": 0.0}),
    "run": Law("steering_gain", "by_run", {"run": 4.0, "value": 0.05, "other": 1.0}),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "law", [pytest.param(law, marks=pytest.mark.matrix if place else ()) for place, law in enumerate(LAWS)]
)
def test_a_gain_that_vanishes_by_a_law_is_no_fault_of_the_steering(law: str) -> None:
    frames = make_third_logs(TruthCase("law", 7, laws=(LAWS[law],)))
    marked = mark_steering_faults([build_log(frame, frame.attrs["name"]) for frame in frames])
    assert [fault.id for log in marked for fault in log.faults] == []


def make_run(shares: np.ndarray, run: int, seed: int = 1) -> PathShares:
    """One segment of blocks of a second at angles, paces and places drawn from a seed."""
    rng = np.random.default_rng([seed, run])
    angles = rng.choice([-1.0, 1.0], BLOCKS) * rng.uniform(5.0, 25.0, BLOCKS)
    places = rng.uniform(-200.0, 200.0, (2, BLOCKS))
    return PathShares(STEPS * np.arange(BLOCKS), shares, angles, rng.uniform(0.8, 2.4, BLOCKS), places)


def follow(seed: int) -> np.ndarray:
    return 1.0 + 0.05 * np.random.default_rng(seed).standard_normal(BLOCKS)


SPAN = PathSpan(2, 0, STEPS * 20, STEPS * 35)


def stop(shares: np.ndarray) -> np.ndarray:
    """The shares with those of the span at nothing."""
    out = shares.copy()
    out[20:36] = 0.0
    return out


def test_a_sudden_stop_in_one_run_is_left() -> None:
    blocks = [[make_run(follow(run) if run != 2 else stop(follow(run)), run)] for run in range(5)]
    assert find_spans_by_law([SPAN], blocks) == set()


def test_a_share_that_falls_before_the_stop_follows_a_law() -> None:
    fading = stop(np.linspace(1.0, 0.4, BLOCKS))
    fading[:20] = np.linspace(1.0, 0.4, 20)
    fading[36:] = 1.0
    blocks = [[make_run(follow(run) if run != 2 else fading, run)] for run in range(5)]
    assert find_spans_by_law([SPAN], blocks) == {SPAN}


def test_a_run_that_never_followed_has_no_onset() -> None:
    blocks = [[make_run(follow(run) if run != 2 else 0.05 * follow(run), run)] for run in range(5)]
    assert find_spans_by_law([SPAN], blocks) == {SPAN}


def test_what_happens_again_at_a_place_follows_a_law() -> None:
    blocks = [[make_run(follow(run) if run not in (2, 3) else stop(follow(run)), run)] for run in range(5)]
    same_place = blocks[3][0].places.copy()
    same_place[:, 20:36] = blocks[2][0].places[:, 20:36]
    last = blocks[3][0]
    blocks[3] = [PathShares(last.rows, last.shares, last.angles, last.paces, same_place)]
    assert find_spans_by_law([SPAN], blocks) == {SPAN}


def test_a_path_in_proportion_to_other_angles_follows() -> None:
    weaker = follow(2)
    weaker[20:36] *= 0.5
    blocks = [[make_run(follow(run) if run != 2 else weaker, run)] for run in range(5)]
    assert find_spans_by_law([SPAN], blocks) == {SPAN}
