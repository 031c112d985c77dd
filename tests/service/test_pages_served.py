"""How the page is served: headers, no script or style within, and every part of it in the package."""

import fnmatch
import json
import re
import tomllib
from html.parser import HTMLParser
from pathlib import Path

import pytest

from fields.documents.sources import FIELD_FORMATS
from planner.service.pages.static_files import STATIC_FOLDER
from tests.service.conftest import Shared

ROOT = Path(__file__).parents[2]
MADE = STATIC_FOLDER / "js/accepted.js"  # by the service, from the endings that it takes
FIELD_ENDINGS = {".zip", *(end for form in FIELD_FORMATS if form.has_lone_files for end in form.extensions)}
PARTS = sorted(path for path in STATIC_FOLDER.rglob("*") if path.is_file())


def test_the_page_lets_nothing_run_but_its_own_files(shared: Shared) -> None:
    answer = shared[0].get("/")
    policy = answer.headers["content-security-policy"]
    assert answer.status_code == 200 and "default-src 'self'" in policy and "unsafe" not in policy
    found: list[tuple[str, dict[str, str | None]]] = []

    class Tags(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            found.append((tag, dict(attrs)))

    Tags().feed(answer.text)
    assert all("src" in attributes for tag, attributes in found if tag == "script")
    assert "style" not in {tag for tag, _ in found}
    assert not [name for _, attributes in found for name in attributes if name == "style" or name.startswith("on")]


@pytest.mark.parametrize("path", PARTS, ids=lambda path: path.name)
def test_every_part_is_served_and_packaged_and_makes_no_markup_of_text(shared: Shared, path: Path) -> None:
    name = path.relative_to(STATIC_FOLDER).as_posix()
    answer = shared[0].get(f"/static/{name}")
    assert answer.status_code == 200 and answer.headers["cache-control"] == "no-cache"
    kinds = {".js": "javascript", ".css": "text/css", ".svg": "image/svg", ".html": "text/html"}
    assert kinds[path.suffix] in answer.headers["content-type"]
    globs = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["package-data"]
    assert any(fnmatch.fnmatch(f"static/{name}", glob) for glob in globs["planner.service.pages"])
    if path.suffix == ".js":
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function", text)
        assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", text), "nothing of another site"
        for other in re.findall(r'from "(\.[^"]+)"', text):
            assert (path.parent / other).is_file() or (path.parent / other).resolve() == MADE, other


def test_nothing_else_is_served_and_the_example_of_a_day_is_there(shared: Shared) -> None:
    client = shared[0]
    for path in ("/static/nothing.js", "/static/../mount.py", "/static/%2e%2e/mount.py", "/mount.py"):
        assert client.get(path).status_code in (404, 405), path
    assert tomllib.loads(client.get("/static/example-day.toml").text)["fields"]


def test_the_page_takes_the_files_that_the_service_takes(shared: Shared) -> None:
    answer = shared[0].get(f"/static/{MADE.relative_to(STATIC_FOLDER).as_posix()}")
    assert answer.status_code == 200 and "javascript" in answer.headers["content-type"]
    accepted = json.loads(answer.text.removeprefix("export const ACCEPTED = ").rstrip(";\n"))
    assert {".geojson", ".kmz", ".fgb", ".xml", ".zip"} <= set(accepted["fields"].split(",")) == FIELD_ENDINGS
    assert accepted["tractors"] == ".toml" and ".shp" not in accepted["fields"]
