"""How far guided points' paths go outside a field, over all the tractors of a run."""

from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.coverage import measure_outside_m
from vehicle.missions.run import SimulationRun


def measure_excursion_m(run: SimulationRun, context: PlanningContext) -> float:
    """The farthest (m) that the guided points' paths go outside the field; 0 where they stay inside."""
    return max(float(measure_outside_m(run, tractor, context).max()) for tractor in range(run.plan.tractors))
