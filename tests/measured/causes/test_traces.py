"""Traces: what they promise in the place of a part is what a trial there takes away, where lines are straight."""

from typing import Any

import numpy as np
import pytest

from tests.measured.benches import bench_of, eg105, knobs, linear_bench
from vehicle.measured.causes.challenge import challenged
from vehicle.measured.causes.refit import restarted, without
from vehicle.measured.causes.traces import Traces
from vehicle.measured.causes.trial import Projector, promised, tried
from vehicle.measured.fit.fitting import refined
from vehicle.measured.thresholds import FAR_LESS


def test_a_rival_is_hopeless_where_a_trial_would_gain_far_less() -> None:
    bench: Any = linear_bench(steering_offset=1.0, heading_bias=-2.0)
    bench.columns["grip_drift"] += 0.5 * bench.columns["heading_bias"]
    fit = refined(bench, bench.fit("steering_offset", "heading_bias"))
    rest, rival = without(bench, fit, "heading_bias"), knobs("grip_drift")
    assert without(bench, fit, "heading_bias") is rest, "asked again it is not fitted again"
    project, traces = Projector(rest.slope), Traces(bench.changes, fit, bench.surprise(fit.settings))
    gain = tried(bench.changes, rest, rival, project).gain
    asked, left = len(bench.asked), project(rest.surprise)
    assert not traces.hopeless(left, project, rival, 0.99 * gain / FAR_LESS)
    assert traces.hopeless(left, project, rival, 1.01 * gain / FAR_LESS)
    assert len(bench.asked) <= asked + len(rival.starts), "simulated once, however often it is asked for"


def test_products_of_what_a_projector_leaves() -> None:
    rng = np.random.default_rng(4)
    slope, columns, left = rng.standard_normal((30, 3)), rng.standard_normal((30, 2)), rng.standard_normal(30)
    project = Projector(slope)
    alone = np.stack([project(one) for one in columns.T], axis=1)
    assert project.products(columns) == pytest.approx(alone.T @ alone, abs=1e-9)
    exact = np.linalg.lstsq(alone, left, rcond=None)[0]
    assert promised(alone.T @ alone, alone.T @ left) == pytest.approx(float((alone.T @ left) @ exact), rel=1e-6)


def test_with_two_parts_the_stand_in_still_gives_way() -> None:
    """As with one part (test_challenge), beside a second one that is true: traces leave the better rival in."""
    bench = bench_of("circles", {"steering_offset": {"angle_deg": 1.0}, "heading_bias": {"angle_deg": -1.5}})
    parts = ((knobs("steering_asymmetry"), np.array([0.9])), (knobs("heading_bias"), np.array([-1.5])))
    outcome = challenged(bench, restarted(bench, parts, None), (), eg105())
    assert outcome.better is not None and set(outcome.better.settings) == {"steering_offset", "heading_bias"}
