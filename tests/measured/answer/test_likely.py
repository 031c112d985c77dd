"""What is likely: how large and how helpful it must be, beside what else, and told by whom."""

from collections.abc import Callable, Collection
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.measured.benches import bench_of, eg105, knobs
from vehicle.effects import effect
from vehicle.measured.answer import names
from vehicle.measured.answer.likely import is_likely, reaches_a_limit, surely_told, told_by_surprises
from vehicle.measured.causes.selection import Selection
from vehicle.measured.fit.fitting import Fit, refined
from vehicle.measured.fit.openloop import Model, OpenLoop, Term
from vehicle.measured.mend.extension import Extension
from vehicle.measured.mend.mending import Mended
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import HARM_PCT


@pytest.fixture(scope="module")
def circles() -> Bench:
    """Circles to both sides driven with an offset of 1 degree."""
    return bench_of("circles", {"steering_offset": {"angle_deg": 1.0}})


@pytest.mark.parametrize(
    "name, at, interval, at_limit",
    [
        ("steering_rate", 70.0, (60.0, 80.0), False), ("steering_rate", 88.2, (76.7, 90.0), True),
        ("steering_rate", 2.0, (1.0, 4.0), False), ("steering_rate", 1.0, (1.0, 3.0), True),
        ("steering_lag", 0.04, (0.02, 0.08), False), ("steering_gain", 0.55, (0.5, 0.6), True),
        ("wheel_slip", 0.2, (0.1, 0.3), False), ("steering_dead_time", 1.1, (1.0, 1.2), True),
    ],
)  # fmt: skip
def test_a_limit_is_reached_by_the_interval_too(
    name: str, at: float, interval: tuple[float, float], at_limit: bool
) -> None:
    """A rate of 88 deg/s where 90 is the most that is tried says no more than that the steering is quick."""
    case: Any = SimpleNamespace(
        tractor=eg105(), extension=SimpleNamespace(intervals={name: {effect(name).size.name: interval}}),
        main_terms={name: Term(knobs(name), np.array([at]))},
    )  # fmt: skip
    assert reaches_a_limit(case, name) is at_limit


@pytest.mark.parametrize(
    "at, interval, gain, refused, likely",
    [
        (0.2, (0.05, 0.35), 0.1, (), True), (0.2, (0.05, 0.35), -0.1, (), False),
        (0.2, (-0.05, 0.45), 0.1, (), False), (0.17, (0.05, 0.29), 0.1, (), False),
        (0.2, (0.05, 0.35), 0.1, ("steering_offset",), False),
    ],
)  # fmt: skip
def test_what_is_likely_is_clearly_not_neutral_helps_runs_held_out_and_is_clearly_beyond_tolerance(
    at: float, interval: tuple[float, float], gain: float, refused: tuple[str, ...], likely: bool
) -> None:
    """The tolerance of an offset is 0.12 degrees, and half as much again has to be reached."""
    case: Any = SimpleNamespace(
        bench=SimpleNamespace(has_wheel=True, row_s=0.1), tractor=eg105(), gain_of=lambda name: (gain, (gain, gain)),
        main_terms={"steering_offset": Term(knobs("steering_offset"), np.array([at]))},
        extension=Extension((), {"steering_offset": {"angle_deg": interval}}, {}), refused=frozenset(refused),
    )  # fmt: skip
    assert is_likely(case, "steering_offset") is likely


@pytest.mark.parametrize(
    "at, worth, gain, likely",
    [(0.12, 10.1, 0.0, True), (0.12, 9.9, 0.0, False), (0.12, 10.1, -HARM_PCT, False), (1.2, 99.0, 9.0, False)],
)
def test_what_is_likely_of_the_steering_shows_at_the_wheel_harms_no_path_and_is_at_no_limit(
    at: float, worth: float, gain: float, likely: bool
) -> None:
    case: Any = SimpleNamespace(
        bench=SimpleNamespace(has_wheel=True, row_s=0.1), tractor=eg105(), worth_of=lambda name: worth,
        gain_of=lambda name: (gain, (gain, gain)),
        main_terms={"steering_dead_time": Term(knobs("steering_dead_time"), np.array([at]))},
        extension=Extension((), {"steering_dead_time": {"time_s": (0.06, 0.2)}}, {}), refused=frozenset(),
    )  # fmt: skip
    assert is_likely(case, "steering_dead_time") is likely


@pytest.mark.parametrize(
    "at, gain, likely",
    [(0.13, 0.1, True), (0.11, 0.1, False), (0.13, -0.9 * HARM_PCT, True), (0.13, -HARM_PCT, False)],
)
def test_what_the_surprises_show_surely_need_be_no_larger_than_a_name_and_may_cost_the_path_as_much(
    at: float, gain: float, likely: bool
) -> None:
    """The tolerance of an offset is 0.12 degrees."""
    case: Any = SimpleNamespace(
        bench=SimpleNamespace(has_wheel=True, row_s=0.1), tractor=eg105(), gain_of=lambda name: (gain, (gain, gain)),
        main_terms={"steering_offset": Term(knobs("steering_offset"), np.array([at]))},
        extension=Extension((), {"steering_offset": {"angle_deg": (0.05, 0.21)}}, {}), refused=frozenset(),
    )  # fmt: skip
    assert is_likely(case, "steering_offset", {"steering_offset"}) is likely
    assert not is_likely(case, "steering_offset", {"steering_gain"})


@pytest.mark.parametrize("at_best, wheel, likely", [(0.1, 20.0, True), (-0.1, 20.0, False), (0.1, 9.0, False)])
def test_the_path_speaks_against_a_sure_cause_of_the_steering_where_runs_agree(
    at_best: float, wheel: float, likely: bool
) -> None:
    """The tolerance of a dead band is 0.25 degrees, a tenth of a degree is neutral."""
    case: Any = SimpleNamespace(
        bench=SimpleNamespace(has_wheel=True, row_s=0.1), tractor=eg105(), worth_of=lambda name: wheel,
        gain_of=lambda name: (-5.0, (-12.0, at_best)), refused=frozenset(),
        main_terms={"steering_deadband": Term(knobs("steering_deadband"), np.array([0.42]))},
        extension=Extension((), {"steering_deadband": {"angle_deg": (0.17, 0.67)}}, {}),
    )  # fmt: skip
    assert is_likely(case, "steering_deadband", {"steering_deadband"}) is likely
    assert not is_likely(case, "steering_deadband")


def test_sure_is_what_may_carry_a_name_is_clear_and_is_no_calibration(circles: Bench) -> None:
    """An offset is a fault; a dead time of 0.05 s, the beat of commands and rows, is in any steering."""
    parts = ((knobs("steering_offset"), np.array([1.0])), (knobs("steering_dead_time"), np.array([0.05])))
    surprise = circles.surprise({})
    selection = Selection(circles, Fit(parts, surprise, np.zeros((len(surprise), 0))), (), 12.0)
    both = ("steering_offset", "steering_dead_time")
    assert surely_told(selection, both, both) == {"steering_offset"}
    assert surely_told(selection, both, both[1:]) == surely_told(selection, both[1:], both) == frozenset()


@pytest.mark.parametrize("wheel, settled", [(True, ("named", "steering_lag")), (False, ("named",))])
def test_only_what_a_measured_wheel_cuts_off_is_settled_without_a_name(wheel: bool, settled: tuple[str, ...]) -> None:
    """Where the path is wrong everywhere, what is likely of it is left to what lowers the error."""
    begun: list[list[str]] = []
    case: Any = SimpleNamespace(final=None, extension=SimpleNamespace(ids=frozenset()))
    selection: Any = SimpleNamespace(bench=SimpleNamespace(has_wheel=wheel), fit=None)

    def mended(_: Any, __: Any, kept: list[str], likely: list[str], *more: Any) -> Any:
        begun.append([*kept, *likely])
        raise InterruptedError

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(names, "clear_parts", lambda *_: [])
        patch.setattr(names, "surely_told", lambda *_: frozenset())
        patch.setattr(names, "of_fit", lambda *_: None)
        patch.setattr(names, "case_of", lambda *_: case)
        patch.setattr(names, "_holding", lambda _, kept: (kept, case))
        patch.setattr(names, "_likely_together", lambda *_: (["steering_lag", "understeer"], case))
        patch.setattr(names, "within_noise", lambda *_: False)
        patch.setattr(names, "_mended_with", mended)
        with pytest.raises(InterruptedError):
            names.explained(selection, ["named"], eg105(), lambda: None)
    assert begun == [list(settled)]


def asked_in(
    worth: dict[str, float], likely: Callable[[str, frozenset[str]], bool]
) -> tuple[list[frozenset[str]], list[str]]:
    """Cases asked one after the other, from all effects on, and what is likely in the end; `named` has a name."""
    asked: list[frozenset[str]] = []

    def case_with(kept: Collection[str]) -> Any:
        asked.append(frozenset(kept))
        return SimpleNamespace(extension=SimpleNamespace(ids=frozenset(kept)), worth_of=worth.__getitem__)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(names, "is_likely", lambda case, name, surely: likely(name, case.extension.ids))
        first = case_with({"named", *worth})
        told, last = names._likely_together(case_with, first, ["named"], frozenset())
    assert last.extension.ids == {"named", *told} == asked[-1]
    return asked, told


def test_what_was_likely_beside_what_fell_is_asked_again() -> None:
    """A quick lag made up for a dead time; without that nothing speaks for it."""
    asked, told = asked_in({"lag": 31.0, "dead": -52.0}, lambda name, beside: name == "lag" and "dead" in beside)
    assert told == [] and asked == [{"named", "lag", "dead"}, {"named", "lag"}, {"named"}]


def test_what_is_worth_least_falls_first_and_what_it_spoilt_is_likely_without_it() -> None:
    asked, told = asked_in({"band": 14.0, "dead": -39.0}, lambda name, beside: name == "band" and "dead" not in beside)
    assert told == ["band"] and asked == [{"named", "band", "dead"}, {"named", "band"}]


def selected(bench: Bench, *effects: str) -> Selection:
    """A fit of these effects."""
    surprise = bench.surprise({})
    parts = tuple((knobs(name), np.zeros(knobs(name).count)) for name in effects)
    fit = refined(bench, Fit(parts, surprise, np.zeros((len(surprise), 0)))) if parts else Fit(
        (), surprise, np.zeros((len(surprise), 0))
    )  # fmt: skip
    return Selection(bench, fit, (), 12.0)


@pytest.mark.parametrize(
    "fitted, name, at, told",
    [
        ((), "steering_offset", 1.0, True), ((), "steering_offset", -1.0, False),
        (("steering_offset",), "steering_offset", 0.8, True), (("steering_offset",), "steering_offset", -0.8, False),
        ((), "implement_side_draft", 0.006, False), ((), "antenna_right", 0.1, False),
    ],
)  # fmt: skip
def test_surprises_tell_what_is_there_to_its_side(
    circles: Bench, fitted: tuple[str, ...], name: str, at: float, told: bool
) -> None:
    assert told_by_surprises(selected(circles, *fitted), Term(knobs(name), np.array([at]))) is told


def test_what_stands_in_the_place_of_what_the_surprises_tell_is_not_told_by_them(circles: Bench) -> None:
    """More curvature to the left looks like an offset to the left as long as nothing else explains it."""
    term = Term(knobs("steering_asymmetry"), np.array([0.9]))
    assert told_by_surprises(selected(circles), term)
    assert not told_by_surprises(selected(circles, "steering_offset"), term)


@pytest.mark.parametrize("gain, told, stays", [(5.0, True, True), (5.0, False, False), (-0.1, True, False)])
def test_what_mends_without_being_told_by_the_surprises_leaves_the_model(gain: float, told: bool, stays: bool) -> None:
    term = Term(knobs("steering_gain"), np.array([0.7]))
    loop: Any = OpenLoop(bench_of("circles", {}), {}, ())
    case: Any = SimpleNamespace(main_terms={"steering_gain": term}, gain_of=lambda name: (gain, (gain, gain)))
    empty: Any = SimpleNamespace(main_terms={})
    mended = Mended(loop, Model((term,), np.zeros(0), np.zeros((0, 1))))
    selection: Any = SimpleNamespace(ids=frozenset())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(names, "is_likely", lambda *_: True)
        patch.setattr(names, "told_by_surprises", lambda *_: told)
        patch.setattr(names, "fitted", lambda loop, kept: Model(kept, np.zeros(0), np.zeros((0, len(kept)))))
        patch.setattr(names, "_case_of_mended", lambda *_: empty)
        left = names._without_doubtful(selection, names.Explained(case, [], mended))
    assert left.mended is not None and left.mended.model.ids == ({"steering_gain"} if stays else set())
