"""The options of `headland plan`: those of its request, of the farm that completes it, and how much is simulated."""

from __future__ import annotations

from planner.request.options import PlanOption, list_options
from planner.request.plan_request import MACHINES, OUTPUT, PlanRequest

PLAN_OPTIONS = (
    *list_options(PlanRequest),
    PlanOption(
        "A farm file (headland farm new): tractors, implements, prices. Options win over it.",
        MACHINES,
        "farm",
        api_help="An uploaded farm; what the request gives wins over it.",
        parameter="farm",
    ),
    PlanOption(
        "The implement of the farm file, by name; by default the first that fits.",
        MACHINES,
        "implement",
        parameter="implement",
    ),
    PlanOption(
        "Simulate and show every plan, however slow.", OUTPUT, "all", type=bool, default=False, parameter="simulate_all"
    ),
)
