"""The choice of machines from a farm file, which completes a request."""

from __future__ import annotations

from typing import Annotated

from pydantic.dataclasses import dataclass

from planner.request.options import OptionHelp
from planner.request.plan_request import MACHINES, OUTPUT
from planner.request.validation import STRICT, Text, raise_request_errors


@raise_request_errors
@dataclass(frozen=True, config=STRICT)
class FarmChoice:
    """A farm file whose machines and values complete a request, and whether every plan is simulated."""

    farm: Annotated[
        Text | None,
        OptionHelp(
            "A farm file (headland farm new): tractors, implements, prices. Options win over it.",
            MACHINES,
            api_help="An uploaded farm; what the request gives wins over it.",
        ),
    ] = None
    implement: Annotated[
        str | None, OptionHelp("The implement of the farm file, by name; by default the first that fits.", MACHINES)
    ] = None
    simulate_all: Annotated[bool, OptionHelp("Simulate and show every plan, however slow.", OUTPUT, name="all")] = False
