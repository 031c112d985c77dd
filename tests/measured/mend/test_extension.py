"""What is added to a tractor: intervals, settings for data held out, and the file."""

import math
from pathlib import Path

import numpy as np
import pytest

from tests.measured.benches import bench_of, commanded, eg105, knobs
from vehicle.measured.answer.save import tractor_toml
from vehicle.measured.causes.evidence import robust_covariance
from vehicle.measured.fit.fitting import Fit, refined
from vehicle.measured.fit.knobs import rest_knobs
from vehicle.measured.fit.openloop import OpenLoop, Term, fitted
from vehicle.measured.mend.extended import Alike, extended_tractor
from vehicle.measured.mend.extension import Extension, of_fit, of_mended, off_alike, value_interval
from vehicle.measured.mend.mending import Mended
from vehicle.measured.surprise.bench import Bench
from vehicle.tractor import EffectSetting, load_tractor


@pytest.fixture(scope="module")
def bench() -> Bench:
    return bench_of("circles", {"steering_offset": {"angle_deg": 1.0}})


def offset(at: float, runs: frozenset[int] | None = None) -> Term:
    return Term(knobs("steering_offset"), np.array([at]), runs)


def test_held_out_settings_with_some_of_the_effects() -> None:
    both = {"steering_offset": {"angle_deg": 1.0}, "wheel_slip": {"ratio": 0.1}}
    whole = Extension((offset(1.0),), {}, {0: (both, {}), 1: (both, both)})
    assert whole.only(["wheel_slip"]) == {
        0: ({"wheel_slip": {"ratio": 0.1}}, {}), 1: ({"wheel_slip": {"ratio": 0.1}}, {"wheel_slip": {"ratio": 0.1}})
    }  # fmt: skip
    assert whole.without("wheel_slip")[0] == ({"steering_offset": {"angle_deg": 1.0}}, {})
    assert whole.ids == {"steering_offset"}


def test_intervals_come_from_the_scatter_of_blocks_and_the_tolerance(bench: Bench) -> None:
    names = ("steering_offset", "heading_bias")
    surprise = bench.surprise({})
    fit = refined(bench, Fit(tuple((knobs(name), np.zeros(1)) for name in names), surprise,
                             np.zeros((len(surprise), 0))))  # fmt: skip
    added = of_fit(bench, fit, ["steering_offset"])
    value, sigma = float(fit.parts[0][1][0]), math.sqrt(robust_covariance(bench, fit, few=True)[0, 0])
    wide = math.hypot(1.96 * sigma, 0.12)
    assert added.tolerant["steering_offset"] == {"angle_deg": pytest.approx((value - wide, value + wide))}
    told = math.hypot(1.96 * sigma, 0.2 * 0.12)
    assert added.intervals["steering_offset"] == {"angle_deg": pytest.approx((value - told, value + told))}
    assert told < wide
    assert added.ids == {"steering_offset"} and set(added.intervals) == set(names)
    # The circle to the right is simulated with what the one to the left tells, and the other way.
    (right, _), (left, _) = added.held_out[0], added.held_out[1]
    assert right["steering_offset"]["angle_deg"] == pytest.approx(1.0, abs=0.05)
    assert set(left) == {"steering_offset"}


def test_an_amount_of_the_rest_has_no_tolerance() -> None:
    term = Term(rest_knobs()[0][0], np.array([0.5]))
    assert value_interval(term, np.array([[0.01]]), 0.0) == {
        "angle_by_speed": pytest.approx((0.5 - 0.196, 0.5 + 0.196))
    }


def test_a_time_of_the_steering_is_no_surer_than_the_beat_of_commands_and_half_a_row(bench: Bench) -> None:
    """0.02 s of a controller and an even spread over the 0.1 s of a row, both as standard deviations."""
    late = Term(knobs("steering_dead_time"), np.array([0.2]))
    assert off_alike(bench, late) == pytest.approx(1.96 * math.hypot(0.02, 0.1 / math.sqrt(12.0)))
    latency = Term(knobs("gnss_latency"), np.array([0.2]))
    assert off_alike(bench, latency) == pytest.approx(1.96 * 0.05 / math.sqrt(3.0))  # three that the path cannot part
    assert off_alike(bench, latency, open_loop=True) == pytest.approx(1.96 * 0.05)


def test_values_of_other_makes_are_off_by_a_share_of_the_tolerance(bench: Bench) -> None:
    """A fifth of 0.12 degrees; all of it for a play, which noise of the sensor pushes, and for a dead band."""
    assert off_alike(bench, offset(1.0)) == pytest.approx(0.024)
    assert off_alike(bench, Term(knobs("steering_backlash"), np.array([1.0]))) == pytest.approx(0.25)
    assert off_alike(bench, Term(knobs("steering_deadband"), np.array([1.0]))) == pytest.approx(0.25)


def test_what_lowers_the_open_loop_error_is_told_with_its_interval() -> None:
    loop = OpenLoop(commanded("circles", {"steering_offset": {"angle_deg": 1.0}}))
    model = fitted(loop, (offset(0.0),))
    added = of_mended(Mended(loop, model))
    low, high = added.intervals["steering_offset"]["angle_deg"]
    assert low < 1.0 < high and high - low == pytest.approx(2 * 0.12, abs=0.01)  # no noise: the tolerance alone
    assert added.held_out[0][0]["steering_offset"]["angle_deg"] == pytest.approx(1.0, abs=1e-3)


def test_two_extensions_are_one_with_what_each_tells_of_its_own_effects() -> None:
    half, other = {"steering_offset": {"angle_deg": 1.0}}, {"wheel_slip": {"ratio": 0.1}}
    told = {"steering_offset": {"angle_deg": (0.8, 1.2)}, "heading_bias": {"angle_deg": (0.0, 1.0)}}
    first = Extension((offset(1.0),), told, {0: (half, {})}, {})
    slip = Term(knobs("wheel_slip"), np.array([0.1]))
    both = first.beside(Extension((slip,), {"wheel_slip": {"ratio": (0.05, 0.15)}}, {0: (other, other)}))
    assert both.ids == {"steering_offset", "wheel_slip"} == set(both.intervals)
    assert both.held_out == {0: ({**half, **other}, other)}


def test_the_file_gets_values_intervals_and_their_logs(bench: Bench, tmp_path: Path) -> None:
    lag, slide = Term(knobs("steering_lag"), np.array([0.2])), Term(knobs("side_slip"), np.array([0.0]))
    push = Term(rest_knobs()[-1][0], np.array([0.0123456789]))
    intervals = {
        "steering_offset": {"angle_deg": (0.8, 1.2)}, "steering_lag": {"time_s": (0.1, 0.3)},
        "side_slip": {"limit_g": (0.1, math.inf)}, "push_to_east": {"push_to_east": (0.0, 0.02)},
    }  # fmt: skip
    terms = (offset(1.23456789, frozenset({1})), lag, slide, push)
    before = eg105().model_copy(update={"effects": {
        "wheel_slip": EffectSetting(value={"ratio": 0.05}), "antenna_right": EffectSetting(value={"distance_m": 0.1}),
    }})  # fmt: skip
    alike = {"steering_lag": Alike({"time_s": (0.05, 0.3)}, ("steering_dead_time",))}
    after = extended_tractor(
        bench.course, before, "soil", Extension(terms, intervals, {}), ["steering_offset"], alike, ["wheel_slip"]
    )
    assert set(after.effects) == {"wheel_slip", "steering_offset", "steering_lag"}  # a limit never reached is none
    named, same = after.effects["steering_offset"], after.effects["steering_lag"]
    assert named.value == {"angle_deg": 1.23457} and named.named and named.logs == ("pass 2",)
    assert named.interval == {"angle_deg": (0.8, 1.2)} and named.ground == "soil"
    assert not same.named and same.equivalent_to == ("steering_dead_time",) and same.interval == {"time_s": (0.05, 0.3)}
    assert after.effects["wheel_slip"] is before.effects["wheel_slip"]
    assert after.rest is not None and after.rest.amounts == {"push_to_east": 0.0123457}
    assert after.rest.angle_deg == pytest.approx((-15.0, 15.0), abs=0.2)
    assert after.rest.logs == ("pass 1", "pass 2") and after.rest.interval == {"push_to_east": (0.0, 0.02)}
    path = tmp_path / "mine.toml"
    path.write_text(tractor_toml(after), encoding="utf-8")
    assert load_tractor(path) == after
