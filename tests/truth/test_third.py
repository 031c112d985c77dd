"""The third reference against closed forms, its columns against their clocks, its faults against their onsets."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from tests.truth import third_body as body
from tests.truth import third_columns as columns
from tests.truth import third_run as run
from tests.truth.cases import KINDS, ColumnClock, Fault, Law, TruthCase
from tests.truth.drives import Drive, constant, drive, stairs, triangle
from tests.truth.laws import encode_law, evaluate_law
from tests.truth.third import Third, Track, calibrate_curve, draw_waves, make_third_logs
from tests.truth.third_columns import EXACT
from tests.truth.third_draw import draw_third_cases
from tests.truth.third_drives import PROGRAMMES
from tests.truth.third_outside import OUTSIDE_CAUSES

Array = npt.NDArray[np.float64]
PACE = 5.0 / 3.6


def hide(**hidden: object) -> Third:
    """A tractor on ground without ridges, logged exactly; `hidden` are further fields of its case."""
    return Third(TruthCase("mixed", 3, **hidden), EXACT, 0.0)  # type: ignore[arg-type]


def hold(angle_deg: float, speed: float = PACE, tool: float = 0.0, seconds: float = 30.0) -> Drive:
    return drive("hold", seconds, constant(angle_deg), speed, tool, bearing_deg=70.0)


def find_bends(track: Track) -> Array:
    """Curvature of the way of the centre of mass, by its course."""
    east, north = track.column(body.EAST), track.column(body.NORTH)
    course = np.unwrap(np.arctan2(np.diff(east), np.diff(north)))
    return np.diff(course) / np.hypot(np.diff(east), np.diff(north))[1:]


def measure_bend(track: Track, after_s: float = 12.0) -> float:
    return float(np.mean(find_bends(track)[track.time_s[2:] > after_s]))


def weave(seconds: float = 56.0) -> Drive:
    return drive("weave", seconds, triangle(12.0, 14.0), 1.6, bearing_deg=30.0)


@pytest.mark.parametrize("angle", (-20.0, 8.0, 25.0))
def test_loads_carry_the_weight_and_the_moment_of_a_bend(angle: float) -> None:
    state = hide().track(hold(angle, 2.5)).states[-1]
    loads, side = np.zeros(4), state[body.AHEAD] * state[body.YAW_RATE]
    body.load_wheels(state[body.SIDE_PULL], state[body.FORWARD_PULL], loads)
    assert loads.sum() == pytest.approx(body.MASS * body.GRAVITY, rel=1e-9)
    moment = 0.5 * body.TRACK * (loads[0] - loads[1] + loads[2] - loads[3])
    assert moment == pytest.approx(body.MASS * side * body.MASS_HEIGHT, rel=0.01)
    assert abs(loads[0] - loads[1]) < 0.5 * abs(loads[2] - loads[3])  # the front axle turns about its pivot


def test_understeer_is_that_of_tyres_and_axle_loads() -> None:
    """At small bends: mean angle = wheelbase x curvature + (1 / front - 1 / rear stiffness) x side acceleration / g."""
    slopes = []
    for speed in (0.8, 3.0):
        state = body.settle(0.03, speed, 20.0, 0.0)
        bend, side = state[body.YAW_RATE] / state[body.AHEAD], state[body.YAW_RATE] * state[body.AHEAD]
        slopes.append((bend, side))
    (slow_bend, slow_side), (fast_bend, fast_side) = slopes
    gradient = body.BASE * (slow_bend - fast_bend) / (fast_side - slow_side)
    expected = (1.0 / body.FRONT_STIFFNESS - 1.0 / body.REAR_STIFFNESS) / body.GRAVITY
    assert gradient == pytest.approx(expected, rel=0.1)


def test_a_mirrored_drive_differs_by_the_measured_sides_only() -> None:
    state, mirror = (body.settle(sign * 0.2, 2.0, 10.0, 0.4) for sign in (1.0, -1.0))
    assert state[body.YAW_RATE] == pytest.approx(-mirror[body.YAW_RATE], rel=1e-9)
    inside = np.abs(np.linspace(-body.TABLE_MOST, body.TABLE_MOST, body.TABLE_SIZE)) < 0.35
    assert all(np.all(np.diff(calibrate_curve(share)[inside]) > 0.0) for share in (0.0, 0.4))


@pytest.mark.parametrize("lag", (0.1, 0.35))
def test_a_ramp_is_followed_late_by_the_lag(lag: float) -> None:
    ramp = drive("ramp", 14.0, lambda time: 2.0 * time, PACE, bearing_deg=0.0)
    track = hide(effects={"steering_lag": {"time_s": lag}}).track(ramp)
    rows = (track.time_s > 6.0) & (track.time_s < 13.0)
    assert np.mean(track.held_deg[rows] - track.column(body.WHEEL)[rows]) / 2.0 == pytest.approx(lag, abs=0.02)


@pytest.mark.parametrize(("lag", "expected"), [(0.0, body.OWN_SPEED_LAG_S), (1.2, 1.2)])
def test_small_changes_of_speed_come_late_by_the_lag(lag: float, expected: float) -> None:
    change = drive("change", 30.0, constant(0.0), stairs((15.0, 1.4), (15.0, 1.6)), bearing_deg=0.0)
    track = hide(effects={"speed_lag": {"time_s": lag}}).track(change)
    rows = track.time_s >= 15.0
    late = np.sum(1.6 - track.column(body.AHEAD)[rows]) * run.STEP_S / 0.2
    assert late == pytest.approx(expected, rel=0.06)


@pytest.mark.parametrize(
    ("kind", "values", "here", "expected"),
    [
        ("over_minutes", {"start": 1.0, "per_minute": 0.2}, {"time": 90.0}, 1.3),
        ("over_day", {"mean": 1.0, "amplitude": 0.1, "period_s": 400.0, "phase_deg": 0.0}, {"day": 100.0}, 1.1),
        ("by_place", {"at_origin": 1.0, "per_m_east": 0.01, "per_m_north": -0.02}, {"east": 5.0, "north": 3.0}, 0.99),
        ("by_place", {"inside": 0.7, "outside": 1.0, "east_m": 5.0, "north_m": 0.0, "radius_m": 4.0}, {"east": 6.0},
         0.7),
        ("by_implement", {"lifted": 1.0, "working": 2.0}, {"down": 1.0}, 2.0),
        ("by_side", {"left": 9.0, "right": 20.0}, {"side": -1.0}, 9.0),
        ("by_angle", {"at_0": 0.9, "at_27": 1.17}, {"angle": -18.0}, 1.08),
        ("by_speed", {"at_0": 1.0, "per_mps": 0.1}, {"speed": -2.0}, 1.2),
        ("by_run", {"run": 0.0, "value": 0.85, "other": 1.0}, {}, 0.85),
    ],
)  # fmt: skip
def test_laws_are_what_their_table_says(
    kind: str, values: dict[str, float], here: dict[str, float], expected: float
) -> None:
    law = encode_law(Law("steering_gain", kind, values), 0, 0)
    names = ("time", "day", "east", "north", "down", "side", "angle", "speed")
    assert evaluate_law(law, *(here.get(name, 0.0) for name in names)) == pytest.approx(expected)


def test_a_law_of_the_gain_reaches_the_path_of_its_run_only() -> None:
    law = Law("steering_gain", "by_run", {"run": 2.0, "value": 0.85, "other": 1.0})
    odd = hide(laws=(law,))
    bend = [measure_bend(odd.track(hold(10.0, seconds=20.0), index)) for index in (1, 2)]
    assert bend[1] / bend[0] == pytest.approx(0.85, rel=0.005)


def test_a_clock_that_drifts_is_later_at_the_end() -> None:
    times = np.arange(0.0, 60.0, 0.1)
    reading = columns.read_column(ColumnClock(drift_s_per_min=0.4), times, np.random.default_rng(0))
    assert times[-1] - reading.when_s[-1] == pytest.approx(0.4 * times[-1] / 60.0)


@pytest.mark.parametrize("jitter", (0.0, 0.3))
def test_a_held_column_repeats_its_values_with_their_noise(jitter: float) -> None:
    case = TruthCase("column", 4, columns={"steering": ColumnClock(hold_s=2.0, hold_jitter=jitter)}, rate_hz=10.0)
    frame = Third(case).log(weave())
    places = np.flatnonzero(np.diff(frame["steering_deg"].to_numpy()) != 0.0)
    assert np.median(np.diff(places)) == pytest.approx(20.0, abs=1.0 + 20.0 * jitter)
    assert len(places) <= 56.0 / (2.0 * (1.0 - jitter))
    assert (np.ptp(np.diff(places)) > 4) == (jitter > 0.0)


def test_loose_wheels_stop_following_and_stuck_ones_run_to_the_lock() -> None:
    loose, torn, stuck = (
        hide(faults=(Fault(fault_id, 0, 20.0, None, detail),)).track(weave())
        for fault_id, detail in (("steering_loose", {}), ("steering_loose", {"linkage": 1.0}),
                                 ("steering_stuck", {"side": -1.0}))
    )  # fmt: skip
    after = loose.time_s > 21.0
    assert np.ptp(loose.column(body.WHEEL)[after]) < 0.1
    assert np.ptp(torn.column(body.WHEEL)[after]) > 15.0
    assert np.abs(find_bends(torn)[torn.time_s[2:] > 26.0]).max() < 1e-3
    assert stuck.states[-1, body.WHEEL] == pytest.approx(-body.LOCK_DEG, abs=0.2)


def test_a_follower_keeps_to_its_line_and_heeds_a_lost_position() -> None:
    line = PROGRAMMES["closed"]()[0]
    kept = hide().log(line)
    times = kept["time_s"].to_numpy() - kept["time_s"].iloc[0]
    aside = (kept["easting_m"] - kept["easting_m"].iloc[0]).to_numpy() - line.steering(times)
    settled = np.concatenate([aside[(times > end - 2.0) & (times < end)] for end in (12.0, 26.0, 40.0)])
    assert np.abs(settled).max() < 0.15
    fault = Fault("position_lost", 0, 20.0, None, {"mode": 2.0})
    assert np.ptp(hide(faults=(fault,)).log(line)["northing_m"].to_numpy()[times > 20.2]) == 0.0


@pytest.mark.matrix
@pytest.mark.parametrize("name", sorted(OUTSIDE_CAUSES))
def test_every_cause_outside_the_catalogue_changes_a_log(name: str) -> None:
    case = next(
        case for seed in range(100) for case in draw_third_cases(seed, ("outside",)) if set(case.outside) == {name}
    )
    index = round(case.outside[name].get("run", 5.0 if name == "steering_stiction" else 6.0))
    track = PROGRAMMES["three_speeds"]()[index]
    plain, other = (Third(each).log(track, index) for each in (replace(case, outside={}), case))
    places = [plain[axis].to_numpy() - other[axis].to_numpy() for axis in ("easting_m", "northing_m")]
    assert np.hypot(*places).max() > 0.05


def test_ground_is_the_same_at_the_same_place() -> None:
    waves = draw_waves(7, 1.0)
    there, back = (run.find_rut(3.0, -2.0, heading, waves) for heading in (0.4, 0.4 + math.pi))
    assert there == pytest.approx(-back) and there != run.find_rut(3.5, -2.0, 0.4, waves)
    spread = [run.find_rut(east, north, 0.0, waves) for east in np.arange(0, 60, 0.7) for north in (0.0, 9.0, 21.0)]
    assert 0.001 < np.std(spread) < 0.008


def test_cases_are_drawn_fresh_and_shuffled() -> None:
    cases, again, others = draw_third_cases(1), draw_third_cases(1), draw_third_cases(2)
    assert cases == again and cases != others and 35 <= len(cases) <= 45
    assert set(Counter(case.kind for case in cases)) == set(KINDS)
    assert [case.kind for case in cases] != sorted((case.kind for case in cases), key=KINDS.index)
    assert all(case.wanted <= case.allowed for case in cases)
    seen = {name for seed in range(40) for case in draw_third_cases(seed, ("outside",)) for name in case.outside}
    assert seen == set(OUTSIDE_CAUSES)


def test_unknown_words_are_refused() -> None:
    with pytest.raises(ValueError, match="cannot hide 'ghost'"):
        Third(TruthCase("outside", 1, outside={"ghost": {}}))
    with pytest.raises(ValueError, match="programme 'moon'"):
        make_third_logs(TruthCase("clean", 1, programme="moon"))
    with pytest.raises(ValueError, match="kind 'moon'"):
        draw_third_cases(1, ("moon",))
