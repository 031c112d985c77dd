"""The last check of all names: what may be neutral is not told, whatever stage added it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vehicle.identification.diagnosis.results import EQUIVALENT, LIKELY, NAMED, NOT_VISIBLE, Finding, ParameterLaw
from vehicle.identification.verdict import unclear_findings
from vehicle.identification.verdict.unclear_findings import (
    doubt_follow_stage,
    doubt_names,
    doubt_shared_lateness,
    doubt_stand_ins,
    doubt_turning_centre,
    withdraw_cancelling_delays,
    withdraw_unclear,
)
from vehicle.model.effects import get_effect
from vehicle.model.tractor import load_tractor

DAY = ParameterLaw("over_day", {"mean": 1.0, "amplitude": 0.2}, "it swings")


def build_finding(
    value: float, low: float, high: float, status: str = NAMED, law: ParameterLaw | None = None
) -> Finding:
    return Finding(
        "steering_gain", status, {"ratio": value}, {"ratio": (low, high)}, 1.0, (0.5, 1.5), 0.1, "", "path", "words",
        law=law,
    )  # fmt: skip


def build_case() -> Any:
    return SimpleNamespace(
        tractor=load_tractor("eg105"),
        extension=SimpleNamespace(term_ids=frozenset(), terms=()),
        residual_model=SimpleNamespace(row_interval_s=0.1, get_interval_s=lambda _: 0.1),
        final_errors=np.zeros(1),
    )


@pytest.mark.parametrize(
    ("finding", "is_told"),
    [
        (build_finding(1.2, 1.1, 1.3), True),
        (build_finding(1.2, 0.9, 1.5), False),
        (build_finding(1.2, 0.9, 1.5, LIKELY), False),
        (build_finding(1.2, 0.9, 1.5, EQUIVALENT), True),  # its interval reaches to neutral on purpose
        (build_finding(1.001, 1.0005, 1.0015), False),  # within the tolerance of the file
        (build_finding(0.8, 0.75, 0.85, LIKELY), True),
    ],
)
def test_findings_that_may_be_neutral_are_not_told(finding: Finding, is_told: bool) -> None:
    (out,) = withdraw_unclear([finding], build_case())
    assert (out is finding) == is_told
    if not is_told:
        assert (out.status, out.value, out.interval, out.description) == (NOT_VISIBLE, None, None, "")


@pytest.mark.parametrize(
    ("finding", "status"),
    [
        (build_finding(1.08, 1.05, 1.11), NAMED),
        (build_finding(1.08, 1.02, 1.14), LIKELY),  # its ends differ by seven times
        (build_finding(0.9, 0.83, 0.97), LIKELY),
        (build_finding(0.9, 0.84, 0.96), NAMED),
        (build_finding(1.024, 1.008, 1.039), LIKELY),  # one end is nearer to neutral than half a tolerance
        (build_finding(1.0, 0.99, 1.01, law=DAY), NAMED),
    ],
)
def test_what_may_be_hardly_there_is_likely(finding: Finding, status: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unclear_findings, "is_within_noise", lambda *_: False)
    (out,) = withdraw_unclear([finding], build_case())
    assert out == replace(finding, status=status)


@pytest.mark.parametrize(("ends", "status"), [((0.08, 0.12), NAMED), ((0.05, 0.3), LIKELY), ((0.06, 0.4), LIKELY)])
def test_a_limit_is_compared_by_what_it_takes_away(ends: tuple[float, float], status: str) -> None:
    limit = replace(build_finding(0.1, *ends), id="side_slip", value={"limit_g": 0.1}, interval={"limit_g": ends})
    assert withdraw_unclear([limit], build_case())[0].status == status


@pytest.mark.parametrize("is_noise", [True, False])
def test_a_law_with_a_neutral_mean_needs_an_error_to_explain(is_noise: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unclear_findings, "is_within_noise", lambda *_: is_noise)
    finding = build_finding(1.0, 0.99, 1.01, law=DAY)
    (out,) = withdraw_unclear([finding], build_case())
    assert (out.status == NOT_VISIBLE) == is_noise


@pytest.mark.parametrize(
    ("gain", "antenna_m", "status"),
    [
        (1.2, -0.33, LIKELY),  # a sixth of 2 m: rear wheels at a fifth of the angle, to the other side
        (0.9, 0.22, LIKELY),  # to the same side
        (1.2, 0.33, NAMED),
        (1.2, -0.6, NAMED),
    ],
)
def test_an_antenna_that_rear_wheels_would_explain_with_the_gain_is_only_likely(
    gain: float, antenna_m: float, status: str
) -> None:
    bent = build_finding(gain, gain - 0.03, gain + 0.03)
    place = {"distance_m": antenna_m}, {"distance_m": (antenna_m - 0.04, antenna_m + 0.04)}
    antenna = replace(bent, id="antenna_forward", value=place[0], interval=place[1])
    same, out = doubt_turning_centre([bent, antenna], 2.0)
    assert same is bent and out.status == status
    assert doubt_turning_centre([replace(bent, law=DAY), antenna], 2.0)[1].status == status
    assert doubt_turning_centre([antenna], 2.0) == [antenna]


@pytest.mark.parametrize(
    ("antenna_m", "has_unnamed", "status"), [(0.4, True, LIKELY), (0.4, False, NAMED), (-0.4, True, NAMED)]
)
def test_an_antenna_that_takes_back_a_part_of_late_positions_is_only_likely(
    antenna_m: float, has_unnamed: bool, status: str
) -> None:
    template = build_finding(0.0, 0.0, 0.0)
    late = replace(template, id="position_delay", value={"time_s": 0.6}, interval={"time_s": (0.5, 0.7)})
    antenna = replace(template, id="antenna_forward", value={"distance_m": antenna_m}, interval=None)
    assert [one.status for one in doubt_stand_ins([late, antenna], load_tractor("eg105"), has_unnamed)] == [
        NAMED,
        status,
    ]
    assert doubt_stand_ins([antenna], load_tractor("eg105"), has_unnamed)[0].status == NAMED


@pytest.mark.parametrize(
    ("values", "doubtful"),
    [
        ({"steering_rate": 8.0, "steering_lag": 0.6}, {"steering_lag"}),  # 6 deg at 8 deg/s: up to 0.75 s
        ({"steering_rate": 8.0, "steering_lag": 0.9}, set()),
        ({"steering_rate": 8.0, "steering_lag": 0.2}, set()),
        ({"steering_lag": 0.9, "steering_dead_time": 0.3}, {"steering_dead_time"}),  # 0.9 s less 6 deg at 20 deg/s
        ({"steering_lag": 0.9, "steering_dead_time": 0.7}, set()),
        ({"steering_lag": 0.9}, set()),
    ],
)
def test_what_another_gap_of_slewing_looks_like_is_only_likely(values: dict[str, float], doubtful: set[str]) -> None:
    steering = load_tractor("eg105").steering.model_copy(
        update={"switch_deg": 6.0, "rate_deg_per_s": 20.0, "lag_s": 0.3}
    )
    template = build_finding(0.0, 0.0, 0.0)
    named = [
        replace(template, id=name, value={get_effect(name).size.name: value}, interval=None)
        for name, value in values.items()
    ]
    out = doubt_follow_stage(named, steering)
    assert {one.id for one in out if one.status == LIKELY} == doubtful


@pytest.mark.parametrize(
    ("antenna_m", "gain_status", "status"),
    [(0.25, LIKELY, LIKELY), (0.25, NAMED, NAMED), (-0.25, LIKELY, NAMED), (0.8, LIKELY, NAMED)],
)
def test_a_gain_without_a_name_leaves_none_to_an_antenna_that_a_locked_axle_would_move(
    antenna_m: float, gain_status: str, status: str
) -> None:
    """A gain of 0.8 moves the centre of the turn by half a metre at most."""
    bent = build_finding(0.8, 0.78, 0.82, gain_status)
    antenna = replace(
        build_finding(0.0, 0.0, 0.0),
        id="antenna_forward",
        value={"distance_m": antenna_m},
        interval={"distance_m": (antenna_m - 0.05, antenna_m + 0.05)},
    )
    assert doubt_turning_centre([bent, antenna], 2.0)[1].status == status


@pytest.mark.parametrize(
    ("late_s", "speed_s", "statuses"),
    [
        (0.12, 0.13, [LIKELY, NOT_VISIBLE]),  # any vehicle may turn that much later than its wheels
        (0.3, 0.31, [NAMED, NOT_VISIBLE]),  # a receiver that gives the speed as well
        (0.1, 0.4, [NAMED, NAMED]),
        (0.2, -0.2, [NAMED, NAMED]),
    ],
)
def test_a_speed_as_late_as_the_receiver_has_no_clock_of_its_own(
    late_s: float, speed_s: float, statuses: list[str]
) -> None:
    findings = [
        replace(build_finding(1.0, 1.0, 1.0), id=name, value={"time_s": s}, interval={"time_s": (s - 0.06, s + 0.06)})
        for name, s in (("gnss_latency", late_s), ("clock_offset_speed", speed_s))
    ]
    assert [one.status for one in doubt_shared_lateness(findings)] == statuses
    assert doubt_shared_lateness(findings[1:]) == findings[1:]


def test_a_file_of_another_kind_of_vehicle_gives_no_names() -> None:
    findings = [build_finding(1.2, 1.1, 1.3), build_finding(1.2, 1.1, 1.3, EQUIVALENT)]
    assert [finding.status for finding in doubt_names(findings)] == [LIKELY, EQUIVALENT]


@pytest.mark.parametrize(("low", "status"), [(-0.01, LIKELY), (19.0, NAMED)])
def test_a_circle_that_may_help_no_run_held_out_is_only_likely(low: float, status: str) -> None:
    circle = replace(build_finding(0.7, 0.66, 0.74), id="grip_patch", gain_interval=(low, 90.0))
    (out,) = withdraw_unclear([circle], build_case())
    assert out.status == status


@pytest.mark.parametrize(("clock_s", "is_told"), [(0.22, False), (0.05, True), (-0.22, True)])
@pytest.mark.parametrize(
    ("delay", "clock", "sign"),
    [("steering_dead_time", "clock_offset_steering_command", 1.0), ("heading_filter", "clock_offset_heading", -1.0)],
)
def test_two_delays_of_a_column_that_cancel_are_none(
    delay: str, clock: str, sign: float, clock_s: float, is_told: bool
) -> None:
    times = {delay: 0.23, clock: sign * clock_s}
    findings = [
        replace(build_finding(1.0, 0.0, 2.0), id=name, value={"time_s": s}, interval={"time_s": (s - 0.06, s + 0.06)})
        for name, s in times.items()
    ]
    assert [finding.status for finding in withdraw_cancelling_delays(findings)] == [
        NAMED if is_told else NOT_VISIBLE
    ] * 2
