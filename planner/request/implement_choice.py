"""The implement of a request in the table of drafts: the row and depth asked for, else those of the operation."""

from __future__ import annotations

from planner.errors import RequestError, attach_parameter, mark_parameter
from vehicle.energy.draft import SOW, TILL, DraftRule, find_draft_rule, get_draft_rule

PULLED_OPERATIONS = (TILL, SOW)  # others take their power from the shaft
KEPT_GROUND_OPERATIONS = (SOW, "spray")  # finished ground must not be driven over again


def choose_rule(operation: str, width_m: float, draft: str | None, depth_cm: float | None) -> DraftRule | None:
    """Draft of an implement at its working depth; None where it is driven by the shaft.

    Without a row of the table (`draft`) it is that of the operation, without a depth the usual one.

    Raises:
        RequestError: a row or a depth for work that nothing is pulled for.
        VehicleError: an unknown row, or a depth that it does not have.
    """
    for name, value in (("draft", draft), ("depth_cm", depth_cm)):
        if value is not None and operation not in PULLED_OPERATIONS:
            raise RequestError(
                f"{mark_parameter(name)} {value} is of an implement that is pulled through the soil, and "
                f"{mark_parameter('operation')} is {operation}; leave out {mark_parameter(name)}, or give "
                f"{' or '.join(PULLED_OPERATIONS)}.",
                parameter=name,
            )
    with attach_parameter("draft"):
        rule = find_draft_rule(operation, width_m) if draft is None else get_draft_rule(draft)
    if rule is None or depth_cm is None:
        return rule
    with attach_parameter("depth_cm"):
        return rule.set_depth(depth_cm)


def keeps_ground(operation: str, rule: DraftRule | None) -> bool:
    """Whether ground that an implement with a draft has finished must not be driven over again."""
    return operation in KEPT_GROUND_OPERATIONS or (rule is not None and rule.in_furrows)


def check_transport_width(transport_m: float | None, width_m: float) -> None:
    """Refuse an implement that is wider when folded than it is at work (m)."""
    if transport_m is not None and transport_m > width_m:
        raise RequestError(
            f"A transport width of {transport_m:g} m is more than the {width_m:g} m of the implement; give its width "
            f"when folded, or {width_m:g} for one that does not fold.",
            parameter="transport_width_m",
        )
