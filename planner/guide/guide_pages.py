"""Topics of the guide, their pages as Markdown or HTML, and a search through them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from importlib import resources
from itertools import groupby
from typing import Any

from planner.errors import RequestError, suggest_name
from planner.request.options import PlanOption, list_options
from planner.request.plan_request import PlanRequest
from vehicle.energy.draft import DraftRule, load_draft_rules

TOPICS = (
    "tutorial", "obstacles", "headlands", "machines", "terrain", "soil-and-energy", "implements", "weather", "refills",
    "going-on", "day", "many-fields", "sweep", "tracks", "terminals", "task-logs", "diagnosis", "diagnosis-method",
    "vehicle", "service", "operations", "workers", "proxy", "threat-model", "python", "strategies", "reference",
    "options", "architecture", "benchmarks", "glossary",
)  # fmt: skip
"""In the order in which people need them."""
OPTIONS_TOPIC, IMPLEMENTS_TOPIC = "options", "implements"
FILE_TYPES = {
    ".png": "image/png",
    ".conf": "text/plain",
    ".service": "text/plain",
    ".yaml": "text/plain",
    "": "text/plain",
}
LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?://|#)([^)\s]+)\)")
MAX_QUERY_CHARACTERS = 80
IMPLEMENTS_INTRODUCTION = """# Implements and their draft

`headland plan --draft NAME --depth-cm DEPTH` plans with one of these implements; a farm file names it under
`[[implements]]` as `draft = "plough"` and `depth_cm = 20.0`. Without a name, `till` is the cultivator, and `sow` the
drill of its width. Draft is F (A + B v + C v2) W T (ASABE D497): v in km/h, W in the unit of the row, T the depth in cm
where one stands here; see [soil and energy](soil-and-energy.md). Depths are usual ones with the range that can be asked
for, and units lie as far apart as is usual; neither is the standard's.

| name | implement | depth, cm | unit | A, B, C | F fine, medium, coarse | range, % |
|---|---|---|---|---|---|---|
"""
OPTIONS_INTRODUCTION = """# Options of a plan

`headland plan` takes these options; jobs of `/api/v1/plans` take the same names with underscores; Python takes the
parameters of `PlanRequest`, in SI units. A farm file may set those marked with *.
"""


def build_implements_page() -> str:
    """Markdown with a line per implement, in the order of the table."""
    return IMPLEMENTS_INTRODUCTION + "".join(_build_implement_row(rule) for rule in load_draft_rules().values())


def _build_implement_row(rule: DraftRule) -> str:
    depth = (
        f"{rule.depth_cm:g} ({rule.min_depth_cm:g} to {rule.max_depth_cm:g})" if rule.follows_depth else "whole depth"
    )
    unit = "m" if rule.unit == "m" else f"{rule.unit.removesuffix('s')}, {rule.spacing_m:g} m apart"
    cells = (
        f"`{rule.name}`",
        rule.implement,
        depth,
        unit,
        f"{rule.a:g}, {rule.b:g}, {rule.c:g}",
        f"{rule.fine:g}, {rule.medium:g}, {rule.coarse:g}",
        f"{rule.range_pct:g}",
    )
    return f"| {' | '.join(cells)} |\n"


def build_options_page() -> str:
    """Markdown with a table per panel of `headland plan --help`."""
    options = sorted(list_options(PlanRequest), key=lambda option: _list_panels().index(option.panel))
    parts = [OPTIONS_INTRODUCTION]
    for panel, members in groupby(options, key=lambda option: option.panel):
        parts.append(f"## {panel or 'Field'}\n\n| option | parameter | default | meaning |\n|---|---|---|---|")
        parts.append("\n".join(_build_option_row(option) for option in members) + "\n")
    return "\n".join(parts)


def _list_panels() -> list[str]:
    """Panels in the order in which the model names them."""
    return list(dict.fromkeys(option.panel for option in list_options(PlanRequest)))


def _build_option_row(option: PlanOption) -> str:
    cells = (
        f"`{_name_option(option.name)}`{' *' if option.from_farm else ''}",
        f"`{option.parameter}`",
        _format_default(option.default),
        option.format_help(_name_option),
    )
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _name_option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _format_default(default: Any) -> str:
    if default is None or default == () or default is False:
        return ""
    return f"`{','.join(map(str, default)) if isinstance(default, tuple) else default}`"


BUILT_PAGES = {OPTIONS_TOPIC: build_options_page, IMPLEMENTS_TOPIC: build_implements_page}
"""Topics whose pages are made: from the request model, and from the table of drafts."""


@dataclass(frozen=True)
class GuidePage:
    """One page: its topic, its title, and its text as Markdown."""

    topic: str
    title: str
    text: str


@dataclass(frozen=True)
class GuideMatch:
    """A place that a search found: topic, heading of the section, and the line without Markdown."""

    topic: str
    heading: str
    line: str


def read_page(topic: str) -> GuidePage:
    """The page of a topic.

    Raises:
        RequestError: the guide has no such topic; parameter "topic".
    """
    if topic not in TOPICS:
        raise RequestError(
            f"The guide has no topic {topic[:40]!r}; it has {', '.join(TOPICS)}{suggest_name(topic, TOPICS)}.",
            parameter="topic",
        )
    text = BUILT_PAGES[topic]() if topic in BUILT_PAGES else _read_file(f"{topic}.md").decode("utf-8")
    return GuidePage(topic, text.split("\n", 1)[0].removeprefix("# ").strip(), text)


def list_pages() -> list[GuidePage]:
    """All pages, in the order of the topics."""
    return [read_page(topic) for topic in TOPICS]


def read_attachment(name: str) -> tuple[bytes, str] | None:
    """A file beside the pages, such as a picture, with its media type; None if there is none of this name."""
    extension = f".{name.rsplit('.', 1)[1]}" if "." in name else ""
    if extension not in FILE_TYPES or not re.fullmatch(r"[\w-]+(\.\w+)?", name):
        return None
    try:
        return _read_file(name), FILE_TYPES[extension]
    except (FileNotFoundError, IsADirectoryError):
        return None


def search_pages(query: str) -> list[GuideMatch]:
    """Lines that contain every word of a query, upper and lower case alike."""
    words = query[:MAX_QUERY_CHARACTERS].lower().split()
    if not words:
        return []
    return [match for page in list_pages() for match in _search_page(page, words)]


def render_page(page: GuidePage) -> str:
    """The page as HTML; links to other topics are relative to the address of the guide, links out of it are dropped."""
    from markdown_it import MarkdownIt

    return str(MarkdownIt("commonmark", {"html": False}).enable("table").render(LINK.sub(_convert_link, page.text)))


def render_matches(query: str) -> str:
    """The result of a search as HTML."""
    matches = search_pages(query)
    shown = f"<h1>Search: {escape(query[:MAX_QUERY_CHARACTERS])}</h1>"
    if not matches:
        return f"{shown}<p>No page of the guide contains all these words.</p>"
    items = "".join(
        f'<li><a href="{match.topic}">{escape(match.topic)}</a>, {escape(match.heading)}: {escape(match.line)}</li>'
        for match in matches
    )
    return f"{shown}<ul>{items}</ul>"


def _read_file(name: str) -> bytes:
    return resources.files("planner").joinpath("guide", name).read_bytes()


def _search_page(page: GuidePage, words: list[str]) -> Iterator[GuideMatch]:
    heading = page.title
    for line in page.text.splitlines():
        if line.startswith("#"):
            heading = line.lstrip("# ")
        if all(word in line.lower() for word in words):
            plain = LINK.sub(r"\2", line).replace("`", "").replace("**", "").strip("#|- ")
            yield GuideMatch(page.topic, heading, plain)


def _convert_link(match: re.Match[str]) -> str:
    """A link as the service serves it: topics without their extension, and only the text of what it does not have."""
    image, text, target = match.groups()
    path, _, anchor = target.partition("#")
    topic = path.removesuffix(".md")
    if topic in TOPICS:
        return f"[{text}]({topic}{'#' + anchor if anchor else ''})"
    if read_attachment(path) is not None:
        return f"{image}[{text}]({path})"
    return text
