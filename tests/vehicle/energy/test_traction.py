"""Traction by Brixius 1987: worked examples of others, and what must hold for any wheel."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.energy.traction import (
    compute_best_pull_slip,
    compute_gross_traction,
    compute_mobility_number,
    compute_motion_resistance,
    compute_net_traction,
    compute_traction_envelope,
    compute_tractive_efficiency,
    solve_slip,
    solve_slips,
)

mobilities = st.floats(8.0, 300.0)
MAX_SLIP = 0.4


@pytest.mark.parametrize(("mobility", "slip", "gross", "resistance", "net", "efficiency"), [
    (80, 0.05, 0.3151, 0.0553, 0.2598, 0.7833),
    (80, 0.10, 0.5042, 0.0581, 0.4461, 0.7963),
    (80, 0.20, 0.7234, 0.0637, 0.6597, 0.7296),
    (55, 0.10, 0.5024, 0.0649, 0.4375, 0.7837),
    (30, 0.10, 0.4812, 0.0825, 0.3987, 0.7458),
    (15, 0.20, 0.5711, 0.1325, 0.4386, 0.6144),
])  # fmt: skip
def test_the_equations_on_a_grid(
    mobility: float, slip: float, gross: float, resistance: float, net: float, efficiency: float
) -> None:
    """Worked out apart from this code, to four places."""
    assert compute_gross_traction(slip, mobility) == pytest.approx(gross, abs=6e-5)
    assert compute_motion_resistance(slip, mobility) == pytest.approx(resistance, abs=6e-5)
    assert compute_net_traction(slip, mobility) == pytest.approx(net, abs=6e-5)
    assert compute_tractive_efficiency(slip, mobility) == pytest.approx(efficiency, abs=6e-5)


def test_slip_of_a_small_tractor_with_a_plough() -> None:
    """farmdss, tests/test_reference_case_validation.py: VST Shakti MT 180D, one bottom in 1500 kPa, stage by stage.

    It leaves out the shape of the tyre, which a deflection of 0.6 b/d takes out here.
    """
    draft_n, rear_n = 3077.4375, 7702.226
    width_m, diameter_m = 0.2032, 0.78943
    mobility = compute_mobility_number(1500.0, width_m, diameter_m, 0.5 * rear_n, 0.6 * width_m / diameter_m)
    assert mobility == pytest.approx(62.480187, rel=1e-6)
    assert compute_traction_envelope(mobility) == pytest.approx(0.878298, abs=1e-6)
    slip = solve_slip(draft_n / rear_n, mobility, 0.3)
    assert slip == pytest.approx(0.087038, abs=1e-6)
    assert compute_gross_traction(slip, mobility) == pytest.approx(0.46106, abs=1e-5)
    assert compute_motion_resistance(slip, mobility) == pytest.approx(0.06151, abs=1e-5)
    assert compute_tractive_efficiency(slip, mobility) == pytest.approx(0.79116, abs=1e-5)


def test_resistance_of_driven_and_towed_wheels() -> None:
    """farmdss, tests/test_dss_shared.py: Bn 40, slip 10 %."""
    assert compute_motion_resistance(0.10, 40.0) == pytest.approx(0.072906, abs=1e-6)
    assert compute_motion_resistance(0.0, 40.0) == pytest.approx(0.065)
    assert compute_net_traction(0.20, 40.0) > 0.5


def test_mobility_number_by_hand() -> None:
    """farmdss, SIMULATION_ENGINE_FORMULAS.md: 1200 kPa, 0.34 x 1.30 m, 6.89 kN: 77.0, and 43.1 with 1 + 3 b/d alone."""
    plain, shaped = 76.98, 1.0 + 3.0 * 0.34 / 1.30
    assert compute_mobility_number(1200.0, 0.34, 1.30, 6890.0, 0.0) == pytest.approx(plain / shaped, rel=1e-3)
    assert compute_mobility_number(1200.0, 0.34, 1.30, 6890.0, 0.0) == pytest.approx(43.1, abs=0.05)
    assert compute_mobility_number(1200.0, 0.34, 1.30, 6890.0, 0.2) == pytest.approx(86.3, abs=0.05)


@given(mobilities, st.floats(0.0, 1.0))
def test_the_slip_found_gives_the_traction_asked_for(mobility: float, share: float) -> None:
    slip = share * compute_best_pull_slip(mobility, MAX_SLIP)
    net = compute_net_traction(slip, mobility)
    found = solve_slip(net, mobility, MAX_SLIP)
    assert compute_net_traction(found, mobility) == pytest.approx(net, abs=1e-9)
    assert found == pytest.approx(slip, abs=1e-3)  # near the best pull traction hardly depends on slip


@given(mobilities, st.floats(-0.3, 0.9), st.floats(1e-3, 0.2))
def test_slip_grows_with_pull(mobility: float, net_share: float, more: float) -> None:
    less_slip, slip = solve_slip(net_share, mobility, MAX_SLIP), solve_slip(net_share + more, mobility, MAX_SLIP)
    assert -MAX_SLIP <= less_slip <= slip <= MAX_SLIP


@given(mobilities)
def test_no_slip_pulls_more_than_the_best(mobility: float) -> None:
    best = compute_best_pull_slip(mobility, MAX_SLIP)
    most = compute_net_traction(best, mobility)
    assert all(compute_net_traction(slip, mobility) <= most + 1e-12 for slip in np.linspace(0.0, MAX_SLIP, 50))
    assert solve_slip(most + 0.01, mobility, MAX_SLIP) == best


@given(st.floats(8.0, 150.0), st.floats(1.05, 2.0), st.floats(0.02, 0.4))
def test_firmer_ground_pulls_better(mobility: float, more: float, slip: float) -> None:
    assert compute_net_traction(slip, mobility * more) > compute_net_traction(slip, mobility)
    assert compute_tractive_efficiency(slip, mobility * more) > compute_tractive_efficiency(slip, mobility)


def test_a_brake_slips_the_other_way() -> None:
    """At a slip of -s the wheel gives what one that drives at s gives, and its resistance helps."""
    mobility, slip = 40.0, 0.08
    gross = compute_traction_envelope(mobility) * (1.0 - math.exp(-7.5 * slip))
    net = -gross - 1.0 / mobility - 0.5 * slip / math.sqrt(mobility)
    assert solve_slip(net, mobility, MAX_SLIP) == pytest.approx(-slip, abs=1e-9)
    assert solve_slip(-9.0, mobility, MAX_SLIP) == -MAX_SLIP
    assert solve_slips(np.array([net, 0.3]), mobility, MAX_SLIP)[1] == solve_slip(0.3, mobility, MAX_SLIP)
