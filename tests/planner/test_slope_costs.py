"""What slopes mean for the choice of a layout: steady speeds at limited power, and fuel up and down."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely

from fields import Field
from fields.layout.swaths import lay_swaths
from planner.evaluation.layout_choice import SlopeCosts
from vehicle.model.terrain import Terrain
from vehicle.model.tractor import load_tractor
from vehicle.model.work_load import WorkLoad

FIELD = Field("plane", shapely.box(0.0, 0.0, 60.0, 60.0))
PLACES = np.arange(-40.0, 101.0, 4.0)
SLOPE, SPEED_MPS, ROLLING = 0.12, 2.0, 0.06


def build_costs(power_w: float, *, counts_fuel: bool = False) -> SlopeCosts:
    heights = SLOPE * np.broadcast_to(PLACES[:, None], (len(PLACES), len(PLACES)))
    load = WorkLoad(draft_n=(6000.0, 0.0, 0.0), engine_power_w=power_w, driveline_efficiency=0.85)
    return SlopeCosts(Terrain(-40.0, -40.0, 4.0, heights), load, load_tractor("eg105"), ROLLING, counts_fuel)


def build_site(bearing_deg: float) -> Any:
    rules = SimpleNamespace(work_speed_mps=SPEED_MPS, turn_speed_mps=SPEED_MPS)
    return SimpleNamespace(layout=lay_swaths(FIELD, 3.0, 6.0, bearing_deg), rules=rules)


def test_power_gives_the_speed_on_a_grade() -> None:
    costs = build_costs(30_000.0)
    force_n = costs.tractor.mass_kg * 9.80665 * (SLOPE + ROLLING) + 6000.0
    (uphill,) = costs.limit_speeds(np.array([SLOPE]), 10.0)
    assert uphill == pytest.approx(0.85 * 30_000.0 / force_n, rel=1e-6)
    assert costs.limit_speeds(np.array([-0.5]), 10.0) == [10.0], "downhill nothing is lacking"


def test_only_climbs_slow_a_tractor() -> None:
    costs = build_costs(20_000.0)
    assert costs.weigh(build_site(90.0), 1000.0) == pytest.approx(1000.0)
    site = build_site(0.0)
    (uphill,) = costs.limit_speeds(np.array([SLOPE]), SPEED_MPS)
    (downhill,) = costs.limit_speeds(np.array([-SLOPE]), SPEED_MPS)
    slower_s = 0.5 * site.layout.total_length_m * (1.0 / uphill + 1.0 / downhill - 2.0 / SPEED_MPS)
    assert uphill < SPEED_MPS and costs.weigh(site, 1000.0) == pytest.approx(1000.0 + slower_s, rel=1e-6)


def test_fuel_up_and_down_is_no_less_than_across() -> None:
    costs = build_costs(80_000.0, counts_fuel=True)
    across, along = (costs.weigh(build_site(bearing), 1000.0) for bearing in (90.0, 0.0))
    assert 0.0 < across <= along * (1.0 + 1e-9)
