"""The outlines of machines, and how wide a way they need."""

from __future__ import annotations

from strategies.path_planning.machine_body import MachineBody
from vehicle.model.tractor import Implement, Tractor
from vehicle.sim.compile import list_contact_boxes

# A fence is open this far to either side of the entrance, or half the machine plus the margin if that is more.
GATE_HALF_WIDTH_M, GATE_MARGIN_M = 5.0, 1.0


def build_body(tractor: Tractor, implement: Implement) -> MachineBody:
    """The outline boxes of tractor and implement, measured forward from the rear axle."""
    return MachineBody(list_contact_boxes(tractor, implement, -tractor.rear_axle_m), tractor.antenna_forward_m)


def measure_passage_m(tractor: Tractor, implement: Implement) -> float:
    """The width of the narrowest passage that a machine gets through, folded where it folds (m)."""
    return max(implement.transport_width_m if implement.folds else implement.width_m, tractor.width_m)


def measure_half_m(tractor: Tractor, implement: Implement) -> float:
    """Half the width of a tractor with its implement (m)."""
    return 0.5 * max(implement.contact_width_m, tractor.width_m)


def folds_at_gate(tractor: Tractor, implement: Implement) -> bool:
    """Whether an implement is folded on the way in and out, because it is too wide for the entrance."""
    return implement.folds and measure_half_m(tractor, implement) + GATE_MARGIN_M > GATE_HALF_WIDTH_M
