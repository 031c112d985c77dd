"""Sweeps made by hand, for tests of what is said of them."""

from itertools import product

from reports.common.plan_results import PlanResult
from reports.sweep.results import SweepResult, SweptOption, SweptPlan

WIDTHS_M, TRACTORS, PRICES = (3.0, 6.0), (1, 2, 3), (40.0, 50.0)
OPTIONS = (
    SweptOption("width_m", "width", WIDTHS_M, "working width", "m"),
    SweptOption("tractors", "tractors", TRACTORS, "tractors"),
    SweptOption("price_per_hour", "price_per_hour", PRICES, "price per hour"),
)
COMMAND = ("headland", "plan", "--margin", "1", "my field.geojson")


def build_plan(width_m: float, tractors: int, price: float) -> PlanResult:
    """A plan whose time is that of even shares, and whose cost is by the hour; three tractors have none at 3 m.

    It was driven with one or two tractors, and is 25 % uncertain with three.
    """
    if tractors == 3 and width_m == 3.0:
        return PlanResult("split-field", tractors, "auto", False, "There is no work for 3.", is_simulated=False)
    time_s = 36_000.0 / width_m / tractors
    cost = time_s * tractors / 3600.0 * price + 5.0 * tractors
    return PlanResult(
        "split-field", tractors, "auto", True, time_s=time_s, finished_s=time_s, cost=cost, finished_cost=cost,
        worked_pct=99.0, uncertainty_pct=25.0 if tractors == 3 else 0.0, fuel_l=20.0 + tractors, is_simulated=False,
    )  # fmt: skip


def build_result(done: int = 12) -> SweepResult:
    """All combinations, or those done first."""
    points = list(product(*(range(len(option.values)) for option in OPTIONS)))[:done]
    plans = [SweptPlan(point, build_plan(WIDTHS_M[point[0]], TRACTORS[point[1]], PRICES[point[2]])) for point in points]
    return SweepResult("my field", 3.92, OPTIONS, tuple(plans), 12, "EUR", is_priced=True, command=COMMAND)
