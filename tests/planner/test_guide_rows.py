"""What there may be several of has its row where people look for it: a new record fails here until it has one."""

import re

import pytest

from fields.documents.sources import FIELD_FORMATS
from planner.cli.common.options import FIELD_FORMS
from planner.guide.guide_pages import read_page
from planner.service.pages.static_files import STATIC_FOLDER
from reports.plan.figures import PLAN_KEYS
from vehicle.model.effects import CATALOGUE


def list_row_names(page: str, section: str) -> list[str]:
    """What the first column of the table of a section of the guide names."""
    text = read_page(page).text.partition(f"\n## {section}\n")[2].partition("\n## ")[0]
    cells = re.findall(r"^\|([^|]*)\|", text, flags=re.MULTILINE)
    return [name for cell in cells for name in re.findall(r"`(\w+)`", cell)]


def test_every_figure_of_plans_and_nothing_else_is_a_key_of_the_reference() -> None:
    assert sorted(list_row_names("reference", "Keys of a plan in `--json`")) == sorted(PLAN_KEYS)


def test_every_effect_and_nothing_else_is_in_the_guide_of_diagnosis() -> None:
    assert sorted(list_row_names("diagnosis", "Effects")) == sorted(effect.id for effect in CATALOGUE)


@pytest.mark.parametrize("format_name", [one.name for one in FIELD_FORMATS])
def test_every_format_of_fields_is_in_help_form_and_guide(format_name: str) -> None:
    form = (STATIC_FOLDER / "js/pages/plan.js").read_text(encoding="utf-8")
    (hint,) = re.findall(r'filePicker\("fields", .*hint: "([^"]*)"', form)
    assert format_name in FIELD_FORMS.split(", ")
    assert format_name in hint and format_name in read_page("obstacles").text
