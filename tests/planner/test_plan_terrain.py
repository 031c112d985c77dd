"""Plans on heights: driven on them, told with their steepest places, refused where a tractor is stuck, and saved."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely

from fields import Field
from fields.documents.reader import read_field
from fields.documents.writer import write_field
from fields.errors import FieldError
from planner.errors import HeadlandError, RequestError
from planner.evaluation.candidates.evaluate import Candidate, Outcome, _check_run, simulate_candidate
from planner.evaluation.candidates.figures import CandidateRun
from planner.evaluation.candidates.fleet_drive import FleetDriver
from planner.evaluation.candidates.slope_figures import describe_stall, list_slope_remarks
from planner.evaluation.context import PlanningContext
from planner.evaluation.field_physics import FieldPhysics, build_field_physics, read_requested_elevation
from planner.evaluation.ground_sentences import describe_ground
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.farm.machines import FarmTractor
from planner.pipeline.outputs.driving_steps import list_steps
from planner.pipeline.outputs.saved_plans import export_physics, read_physics, rerun_plan, write_saved_plan
from planner.pipeline.outputs.step_measures import measure_steps
from planner.request.plan_request import PlanRequest
from reports.common.plan_records import STUCK, PlanFault
from tests.drawn_fields import feature, rectangle, write_features, write_heights
from vehicle.missions.plan_file import parse_saved_plan
from vehicle.missions.run import Stall
from vehicle.model.terrain import Terrain
from vehicle.model.tractor import StabilityParameters, load_tractor

pytestmark = pytest.mark.usefixtures("first_layout")

FIELD = Field("drawn", shapely.box(0, 0, 18, 60))
ONE = Candidate("row-by-row", 1)


def write_plane(path: Path, east: float, north: float, *, cell_m: float = 2.0) -> Path:
    """An ASCII grid of the plane z = 100 + east x + north y, from -60 m to 160 m."""
    return write_heights(path, lambda x, y: 100.0 + east * x + north * y, -60.0, 160.0, cell_m)


@cache
def tilt(east: float, north: float, **values: str) -> PlanningContext:
    """The field on a plane, without reading a file."""
    request = PlanRequest(field="drawn", no_headland=True, bearing_deg=0.0, **values)  # type: ignore[arg-type]
    level = build_field_physics(request, FIELD, load_tractor("eg105"))
    places = np.arange(-60.0, 161.0, 5.0)
    terrain = Terrain(-60.0, -60.0, 5.0, east * places[None, :] + north * places[:, None])
    return prepare_context(WorkOrder(request, FIELD), physics=FieldPhysics(terrain, level.load, True, soil=level.soil))


@cache
def drive(east: float, north: float) -> Outcome:
    return simulate_candidate(tilt(east, north), ONE)


def test_heights_of_a_file_are_those_that_are_driven(tmp_path: Path) -> None:
    path = write_plane(tmp_path / "plane.asc", 0.08, -0.03)
    request = PlanRequest(field="drawn", elevation=str(path))
    physics = build_field_physics(request, FIELD, load_tractor("eg105"))
    assert physics.driven_load is physics.load
    gradients = physics.terrain.compute_gradients([(3.0, 4.0), (20.0, 60.0)])
    assert gradients == pytest.approx(np.array([[0.08, -0.03]] * 2), abs=1e-3)
    flat = build_field_physics(PlanRequest(field="drawn"), FIELD, load_tractor("eg105"))
    assert flat.terrain is None and flat.driven_load is None and flat.fuel_load is not None


def test_across_a_slope_the_steepest_place_is_told_with_its_side() -> None:
    plan = drive(0.10, 0.0).result
    assert plan.feasible
    assert abs(plan.steepest_across.amount) == pytest.approx(10.0, abs=0.1)
    assert 20.0 < plan.rollover.amount < 45.0
    assert abs(plan.steepest_along.amount) > 8.0, "turns lead up and down"


@pytest.mark.slow
def test_up_and_down_takes_more_fuel_than_level_ground() -> None:
    level, tilted = drive(0.0, 0.0).result, drive(0.0, 0.12).result
    assert tilted.fuel_l > 1.02 * level.fuel_l
    assert abs(tilted.steepest_along.amount) == pytest.approx(12.0, abs=0.1)


@pytest.mark.slow
def test_steps_have_their_slopes_and_add_up_to_the_fuel_of_the_plan() -> None:
    context, driven = tilt(0.0, 0.12), drive(0.0, 0.12)
    assert driven.run is not None
    (steps,) = list_steps(driven.run, 3.0, measure_steps(driven.run, context.tractor, context.physics))
    assert sum(step.fuel_l or 0.0 for step in steps) == pytest.approx(driven.result.fuel_l, rel=1e-3)
    tracks = [step for step in steps if step.kind == "track" and step.bearing_deg is not None]
    for step in tracks:
        uphill = 1.0 if abs(step.bearing_deg or 0.0) < 90.0 or (step.bearing_deg or 0.0) > 270.0 else -1.0
        assert step.slope_along_pct == pytest.approx(12.0 * uphill, abs=0.6)
        assert abs(step.slope_across_pct or 0.0) < 6.0, "it comes out of a turn"


@pytest.mark.slow
def test_too_steep_to_work_uphill_is_worked_downhill() -> None:
    """No move on which the tractor gets stuck is proven, so every track is worked down the plane, none is left."""
    driven = simulate_candidate(tilt(0.0, 0.45, soil="soft"), ONE)
    assert driven.result.feasible
    works = [leg for mission in driven.run.plan.missions for leg in mission.legs if leg.implement and leg.task.is_work]
    assert {round(float(leg.points[0][0]), 1) for leg in works} == {1.5 + 3.0 * number for number in range(6)}
    assert all(leg.points[-1][1] < leg.points[0][1] for leg in works)


@pytest.mark.slow
def test_a_tractor_that_is_stuck_is_told_with_its_place() -> None:
    """A plan made for level ground, driven up the plane."""
    level, steep = simulate_candidate(tilt(0.0, 0.0, soil="soft"), ONE), tilt(0.0, 0.45, soil="soft")
    run = FleetDriver(steep, beside=False).simulate(level.run.plan)
    assert run.stall is not None
    (fault,) = _check_run(steep, CandidateRun(run, None, "")).faults
    assert fault == PlanFault(STUCK, None, run.stall.x_m, run.stall.y_m)
    reason = describe_stall(run.stall, FIELD)
    assert reason.startswith("tractor 1 gets stuck at x ") and "45 % uphill" in reason
    needed, given = re.findall(r"([\d.]+) kN", reason)
    assert "and the ground lets its wheels push with" in reason and float(needed) > float(given) > 20.0


def test_the_drive_force_of_a_file_is_named_with_what_takes_its_place() -> None:
    """Without a soil 0.4 of the weight stands for the grip; a soil of the table says better."""
    stall = Stall(10.0, 0, 1, 3.0, 4.0, -1e-4, "drive force", 22_700.0, 15_000.0)
    reason = describe_stall(stall, FIELD)
    assert ", on level ground: 22.7 kN are needed and its wheels can push with 15.0 kN by its tractor file" in reason
    assert reason.endswith("; name the soil (loam, firm, soft), and its grip counts instead")
    assert "tractor file" not in describe_stall(replace(stall, lacking="grip", grade=0.2), FIELD)


def test_near_rolling_over_is_a_remark() -> None:
    context, driven = tilt(0.10, 0.0), drive(0.10, 0.0)
    assert driven.run is not None and list_slope_remarks(context, driven.run) == []
    stability = StabilityParameters(centre_height_m=1.0, warn_deg=45.0)
    careful = replace(context, tractor=context.tractor.model_copy(update={"stability": stability}))
    (remark,) = list_slope_remarks(careful, driven.run)
    margin = driven.result.rollover
    assert remark.text.startswith(f"tractor 1 comes within {margin.amount:.0f} degrees of rolling")
    assert remark.text.endswith("where the ground slopes by 10 %; its file warns from 45 degrees")


def test_a_saved_plan_is_driven_on_its_heights_without_their_file() -> None:
    context, driven = tilt(0.10, 0.0), drive(0.10, 0.0)
    saved = parse_saved_plan(write_saved_plan(context, driven.run.plan))
    again = rerun_plan(saved, context.request)
    assert again.finish_s.tolist() == driven.run.finish_s.tolist()
    assert (again.record == driven.run.record[: len(again.record)]).all()
    physics = read_physics(saved, context.request, context.tractor)
    assert physics.load == context.physics.load
    assert physics.terrain.heights_m == pytest.approx(context.physics.terrain.heights_m, abs=1e-4)
    level = prepare_context(WorkOrder(PlanRequest(field="drawn", no_headland=True), FIELD))
    assert export_physics(level.physics, level.request, level.tractor) == {}


def test_a_saved_plan_keeps_the_power_that_only_the_farm_knows() -> None:
    """Its fuel is told by it, but on level ground without a soil it is not driven with it."""
    context, driven = tilt(0.0, 0.0), drive(0.0, 0.0)
    tractor = context.tractor.model_copy(update={"engine": None})
    physics = build_field_physics(context.request, FIELD, tractor, FarmTractor(name="own", power_kw=120.0))
    saved = parse_saved_plan(write_saved_plan(replace(context, tractor=tractor, physics=physics), driven.run.plan))
    again = read_physics(saved, context.request, tractor)
    assert again.fuel_load is not None and again.fuel_load == physics.fuel_load
    assert again.driven_load is None and again.terrain is None


@pytest.mark.parametrize(
    "spoil",
    [
        lambda values: values.pop("load"),
        lambda values: values["load"].update(engine_power_w=-1.0),
        lambda values: values["terrain"].update(heights="no base64"),
        lambda values: values["terrain"].update(shape=[3, 3]),
        lambda values: values["terrain"].update(shape=[10**6, 10**6]),
        lambda values: values["terrain"].update(shape=[float("inf"), 3]),
        lambda values: values["terrain"].update(west_m=10**400),
    ],
)
def test_garbled_heights_of_a_saved_plan_are_refused(spoil: Callable[[dict[str, object]], object]) -> None:
    context, driven = tilt(0.10, 0.0), drive(0.10, 0.0)
    saved = parse_saved_plan(write_saved_plan(context, driven.run.plan))
    spoil(saved.scenario["physics"])
    with pytest.raises(RequestError, match="The physics in the scenario of the plan are garbled"):
        read_physics(saved, context.request, context.tractor)


class TestFieldKey:
    """The boundary of a field file names a file beside it."""

    def write(self, folder: Path, name: object) -> Path:

        return write_features(folder / "field.geojson", feature(rectangle(0, 0, 18, 60), elevation=name))

    def test_it_is_read_unless_the_request_has_another(self, tmp_path: Path) -> None:
        write_plane(tmp_path / "own.asc", 0.05, 0.0)
        other = write_plane(tmp_path / "other.asc", 0.02, 0.0)
        field = read_field(self.write(tmp_path, "own.asc"), local=True)
        tractor = load_tractor("eg105")
        for given, slope in ((None, 0.05), (str(other), 0.02)):
            physics = build_field_physics(PlanRequest(elevation=given), field, tractor)
            assert physics.terrain.compute_gradients([(9.0, 9.0)])[0, 0] == pytest.approx(slope, abs=1e-3)
        write_field(field, tmp_path / "again.geojson")
        assert read_field(tmp_path / "again.geojson").elevation == str(tmp_path / "own.asc")

    def test_a_missing_file_is_told_by_its_name_alone(self, tmp_path: Path) -> None:
        field = read_field(self.write(tmp_path, "lost.tif"), local=True)
        with pytest.raises(RequestError, match=r"names the heights 'lost.tif'.* give it as elevation") as caught:
            read_requested_elevation(PlanRequest(), field)
        assert str(tmp_path) not in str(caught.value) and caught.value.parameter == "elevation"

    def test_a_system_without_heights_is_refused(self) -> None:
        with pytest.raises(RequestError, match="elevation_crs is of heights; name those with elevation as well"):
            read_requested_elevation(PlanRequest(elevation_crs="EPSG:25832"), FIELD)

    @pytest.mark.parametrize("name", [123.4, "123.4", None, ["a.tif"]])
    def test_a_mean_height_is_no_file(self, tmp_path: Path, name: object) -> None:
        assert read_field(self.write(tmp_path, name), local=True).elevation is None

    @pytest.mark.parametrize("name", ["../secret.tif", "/etc/heights.csv", "a\\b.tif"])
    def test_it_lies_beside_the_field(self, tmp_path: Path, name: str) -> None:
        with pytest.raises(FieldError, match="put the file beside the field file"):
            read_field(self.write(tmp_path, name), local=True)


class TestSoil:
    def test_the_name_chooses_the_load_and_says_what_it_bears(self) -> None:
        context = prepare_context(
            WorkOrder(PlanRequest(field="drawn", no_headland=True, soil="loam", moisture_pct=22.0), FIELD)
        )
        load = context.physics.driven_load
        assert load is not None and load.mobility_number is not None and context.physics.terrain is None
        sentences = " ".join(describe_ground(context))
        assert "The soil is loam at 22 % moisture, cone index" in sentences
        assert (
            "Loam is compacted when it is worked from about 18 % of moisture" in sentences
            and "it has 22 %." in sentences
        )
        assert "Fuel is that of an engine of 77 kW" in sentences

    def test_a_wide_implement_is_stuck_where_a_narrow_one_is_not(self) -> None:
        wide = PlanRequest(field="drawn", no_headland=True, soil="silt loam", width_m=9.0)
        told = " ".join(describe_ground(prepare_context(WorkOrder(wide, Field("drawn", shapely.box(0, 0, 90, 90))))))
        assert "Silt loam does not give the pull for this work from about" in told

    def test_a_table_of_ones_own(self, tmp_path: Path) -> None:
        path = tmp_path / "own.csv"
        head = "name,moisture_pct,cone_index_kpa\n"
        path.write_text(f"{head}north,10,1500\nnorth,30,500\n")
        one = build_field_physics(PlanRequest(soil=str(path), moisture_pct=20.0), FIELD, load_tractor("eg105"))
        assert one.soil.cone_index_kpa == pytest.approx((1500.0 * 500.0) ** 0.5)
        path.write_text(f"{head}north,10,1500\nsouth,10,900\n")
        named = build_field_physics(PlanRequest(soil=f"{path}#south"), FIELD, load_tractor("eg105"))
        assert named.soil.cone_index_kpa == 900.0
        with pytest.raises(RequestError, match="has 2 soils; name one as"):
            build_field_physics(PlanRequest(soil=str(path)), FIELD, load_tractor("eg105"))

    @pytest.mark.parametrize(
        ("values", "words"),
        [
            ({"soil": "lome"}, "The soil 'lome' is unknown"),
            ({"soil": ""}, "The soil '' is unknown"),
            ({"soil": "loam", "moisture_pct": 90.0}, "outside of what is known"),
            ({"moisture_pct": 20.0}, "moisture_pct is of a soil"),
            ({"soil": "missing.csv"}, "missing.csv"),
        ],
    )
    def test_what_there_is_not_is_refused(self, values: dict[str, object], words: str) -> None:
        with pytest.raises(HeadlandError, match=words):
            build_field_physics(PlanRequest(**values), FIELD, load_tractor("eg105"))  # type: ignore[arg-type]
