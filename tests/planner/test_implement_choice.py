"""The implement and depth of a request: options and farm files, what is refused, and what the plan makes of them."""

import re
from dataclasses import replace

import pytest
import shapely

from fields import Field
from planner.errors import HeadlandError, RequestError
from planner.evaluation.field_physics import build_field_physics
from planner.evaluation.preparation import prepare_context
from planner.evaluation.pull_check import compute_pull_figures, describe_pull
from planner.evaluation.work_order import WorkOrder
from planner.farm.inventory import parse_farm
from planner.guide.guide_pages import IMPLEMENTS_TOPIC, read_page
from planner.pipeline.farm_inputs import complete_request_by_farm
from planner.pipeline.outputs.saved_plans import _export_request, read_request
from planner.pipeline.ranking import export_request
from planner.request.plan_request import PlanRequest
from reports.plan.shortfall_wording import question_pull
from vehicle.energy.draft import find_draft_rule, load_draft_rules
from vehicle.energy.load import find_drawbar_share
from vehicle.missions.plan import Plan
from vehicle.missions.plan_file import SavedPlan
from vehicle.model.soil import find_soil
from vehicle.model.tractor import load_tractor

FIELD = Field("drawn", shapely.box(0, 0, 36, 80))
EG105 = load_tractor("eg105")
KMH = 1.0 / 3.6
FARM = """
[[implements]]
name = "plough"
width_m = 1.4
draft = "Mounted-Planter"
[[implements]]
name = "deep"
draft = "plough"
depth_cm = 30.0
"""


@pytest.mark.parametrize("operation", ["till", "sow", "spray", "harvest", "mow"])
def test_without_a_choice_the_operation_has_its_usual_rule(operation: str) -> None:
    request = PlanRequest(operation=operation, width_m=3.0)
    assert request.find_draft_rule() == find_draft_rule(operation, 3.0)
    assert "draft" not in _export_request(request) and "depth_cm" not in _export_request(request)


def test_the_plan_pulls_the_row_and_depth_asked_for() -> None:
    """A plough 1.4 m wide in loam, 30 cm deep at 5 km/h: 0.7 (652 + 5.1 x 25) 1.4 x 30 N."""
    request = PlanRequest(field="drawn", width_m=1.4, speed_mps=5 * KMH, soil="loam", draft="plough", depth_cm=30.0)
    physics = build_field_physics(request, FIELD, EG105)
    assert not physics.takes_shaft_power
    assert physics.driven_load.compute_draft_n(5 * KMH) == pytest.approx(0.7 * (652 + 5.1 * 25) * 1.4 * 30)
    context = prepare_context(WorkOrder(replace(request, no_headland=True), FIELD))
    scenario = export_request(context)
    assert scenario["draft"] == "plough" and scenario["depth_cm"] == 30.0
    usual = export_request(prepare_context(WorkOrder(PlanRequest(field="drawn", no_headland=True), FIELD)))
    assert "draft" not in usual and "depth_cm" not in usual


@pytest.mark.parametrize(("values", "sentence"), [
    ({"draft": "ploughs"}, "The implement 'ploughs' is not in the table of drafts (did you mean 'plough'?); use one"),
    ({"draft": "drill", "depth_cm": 4.0}, "The draft of the drill holds for its whole depth; leave out the depth."),
    ({"operation": "sow", "depth_cm": 4.0}, "The draft of the drill holds for its whole depth"),
    ({"draft": "plough", "depth_cm": 50.0}, "The working depth is 50 cm, and 'plough' works 10 to 35 cm deep"),
    ({"depth_cm": 2.0}, "The working depth is 2 cm, and 'cultivator' works 5 to 25 cm deep"),
    ({"depth_cm": 200.0}, "cm; use more than 0 and at most 100 cm"),
    ({"operation": "mow", "draft": "plough"}, "is of an implement that is pulled through the soil"),
    ({"operation": "spray", "depth_cm": 12.0}, "is of an implement that is pulled through the soil"),
])  # fmt: skip
def test_what_the_table_does_not_have_is_refused(values: dict[str, object], sentence: str) -> None:
    with pytest.raises(HeadlandError, match=re.escape(sentence)) as refusal:
        PlanRequest(**values)  # type: ignore[arg-type]
    assert refusal.value.parameter in values


def test_a_farm_names_rows_and_options_win() -> None:
    farm = parse_farm(FARM, "farm.toml")
    of_farm = complete_request_by_farm(PlanRequest(), farm, implement_name="deep").request
    assert (of_farm.draft, of_farm.depth_cm) == ("plough", 30.0)
    first = complete_request_by_farm(PlanRequest(), farm).request.find_draft_rule()
    assert first.name == "mounted-planter"
    given = complete_request_by_farm(PlanRequest(draft="disk-harrow"), farm, ["draft"], implement_name="deep").request
    assert (given.draft, given.depth_cm) == ("disk-harrow", None), "the depth is that of the farm's plough"
    mown = complete_request_by_farm(PlanRequest(operation="mow"), farm, ["operation"], implement_name="deep").request
    assert mown.find_draft_rule() is None
    tilling = FARM.replace('name = "deep"', 'name = "deep"\noperation = "till"')
    same = complete_request_by_farm(
        PlanRequest(operation="till"), parse_farm(tilling, "farm.toml"), ["operation"], implement_name="deep"
    ).request
    assert (same.draft, same.depth_cm) == ("plough", 30.0)
    deeper = complete_request_by_farm(PlanRequest(depth_cm=25.0), farm, ["depth_cm"], implement_name="deep").request
    assert (deeper.draft, deeper.depth_cm) == ("plough", 25.0)


@pytest.mark.parametrize(("lines", "sentence"), [
    ('draft = "plows"', "'plows' is not in the table of drafts"),
    ('draft = "plough"\ndepth_cm = 60.0', "The working depth is 60 cm, and 'plough' works 10 to 35 cm deep"),
    ('operation = "mow"\ndraft = "plough"', "pulled through the soil"),
    ("draft = 3", "draft"),
])  # fmt: skip
def test_a_fault_of_a_farm_file_is_one_sentence(lines: str, sentence: str) -> None:
    with pytest.raises(RequestError, match=r"The farm file farm\.toml cannot be used") as refusal:
        parse_farm(f'[[implements]]\nname = "x"\n{lines}\n', "farm.toml")
    assert sentence in str(refusal.value) and "\n" not in str(refusal.value)


def test_the_question_of_an_implement_of_the_table_names_its_own_range() -> None:
    request = PlanRequest(width_m=4.0, speed_mps=8 * KMH, draft="plough")
    pull = compute_pull_figures(request, EG105)
    assert pull.is_questioned and pull.depth_cm == 22.0
    assert question_pull(pull).startswith("Not feasible at this speed. The implement of 4 m needs about ")
    assert (
        "22 cm deep in medium soil, is that of ASAE D497, give or take 40 %"
        in describe_pull(pull, request.find_draft_rule())[0]
    )


def test_the_share_at_the_drawbar_follows_drive_and_soil() -> None:
    """D497, figure 1, as tcc quotes it; a harder soil and more driven wheels never give less."""
    soils = [find_soil("soft"), find_soil("tilled"), find_soil("firm")]
    shares = []
    for drive in ("2wd", "mfwd", "4wd"):
        tyres = EG105.tyres.model_copy(update={"driven_wheels": drive})
        shares.append([find_drawbar_share(EG105.model_copy(update={"tyres": tyres}), soil) for soil in soils])
    assert shares == [[0.55, 0.67, 0.72], [0.65, 0.73, 0.77], [0.70, 0.75, 0.78]]
    assert find_drawbar_share(EG105) == find_drawbar_share(EG105, find_soil("mud")) == 0.73


def test_a_saved_plan_keeps_the_implement() -> None:
    request = PlanRequest(draft="plough", depth_cm=20.0)
    saved = SavedPlan(Plan(missions=()), scenario=_export_request(request))
    assert read_request(saved) == request


def test_the_guide_lists_every_row() -> None:
    text = read_page(IMPLEMENTS_TOPIC).text
    for rule in load_draft_rules().values():
        assert f"| `{rule.name}` | {rule.implement} |" in text
    assert "| 22 (10 to 35) |" in text and "| whole depth |" in text
