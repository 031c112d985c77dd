"""`headland guide` and the pages of the guide: topics, search, links, and what the service shows."""

import re

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from planner.errors import RequestError
from planner.guide.guide_pages import (
    BUILT_PAGES,
    OPTIONS_TOPIC,
    TOPICS,
    list_pages,
    read_attachment,
    read_page,
    render_page,
    search_pages,
)
from planner.request.options import list_options
from planner.request.plan_request import PlanRequest
from planner.service.pages.static_files import mount_pages
from tests.cli.conftest import Run
from tests.cli.examples import README


def test_every_page_is_a_topic_and_the_readme_links_it() -> None:
    folder = README.parent / "planner" / "guide"
    assert {path.stem for path in folder.glob("*.md")} == set(TOPICS) - set(BUILT_PAGES)
    linked = re.findall(r"\(planner/guide/([\w-]+)\.md\)", README.read_text(encoding="utf-8"))
    assert set(TOPICS) - set(BUILT_PAGES) <= set(linked)


def test_topics_are_listed_and_printed(headland: Run) -> None:
    done = headland("guide")
    assert done.status == 0 and all(f"`{topic}`" in done.out for topic in TOPICS)
    done = headland("guide", "obstacles")
    assert done.status == 0 and done.out.startswith("# Fields, obstacles")


def test_an_unknown_topic_is_refused_with_the_nearest(headland: Run) -> None:
    done = headland("guide", "obstacle")
    assert done.status == 2 and "'obstacles'" in done.err and done.err.count("\n") == 1
    with pytest.raises(RequestError) as refusal:
        read_page("../pyproject")
    assert refusal.value.parameter == "topic"


def test_a_search_finds_lines_with_all_words(headland: Run) -> None:
    assert {match.topic for match in search_pages("Fence boundary")} >= {"obstacles"}
    assert search_pages("  ") == [] and search_pages("no page has zzyzx") == []
    assert "No page" in headland("guide", "--search", "zzyzx").out


def test_attachments_are_files_beside_the_pages_alone() -> None:
    found = read_attachment("nginx.conf")
    assert found[1] == "text/plain"
    assert [
        read_attachment(name) for name in ("../errors.py", "obstacles.md", "guide_pages.py", "nothing.png")
    ] == 4 * [None]


@pytest.mark.parametrize("topic", TOPICS)
def test_links_of_a_rendered_page_lead_to_pages(topic: str) -> None:
    targets = re.findall(r'(?:href|src)="(?!https?:|#)([^"#]+)', render_page(read_page(topic)))
    assert [target for target in targets if target not in TOPICS and read_attachment(target) is None] == []


def test_the_service_shows_the_guide() -> None:
    app = FastAPI()
    mount_pages(app)
    client = TestClient(app)
    assert client.get("/guide").url.path == "/guide/"
    assert all(page.topic in client.get("/guide/").text for page in list_pages())
    assert "<table" in client.get("/guide/headlands").text
    assert client.get("/guide/nothing").status_code == 404
    found = client.get("/guide/", params={"q": "<script>fence"})
    assert found.status_code == 200 and "<script" not in found.text and "&lt;script&gt;" in found.text


def test_the_page_of_options_has_every_option_of_the_model() -> None:
    text = read_page(OPTIONS_TOPIC).text
    for option in list_options(PlanRequest):
        assert f"| `--{option.name.replace('_', '-')}`" in text and f"`{option.parameter}`" in text
