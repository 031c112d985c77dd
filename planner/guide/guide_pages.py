"""Topics of the guide, their pages as Markdown or HTML, and a search through them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from importlib import resources

from planner.errors import RequestError, suggest_name
from planner.guide.implements_page import build_implements_page
from planner.guide.options_page import build_options_page

TOPICS = (
    "tutorial", "obstacles", "headlands", "machines", "terrain", "soil-and-energy", "implements", "weather", "refills",
    "going-on", "day", "many-fields", "terminals", "task-logs", "diagnosis", "diagnosis-method", "vehicle", "service",
    "operations", "proxy", "threat-model", "python", "strategies", "reference", "options", "architecture",
    "benchmarks", "glossary",
)  # fmt: skip
"""In the order in which people need them."""
OPTIONS_TOPIC, IMPLEMENTS_TOPIC = "options", "implements"
BUILT_PAGES = {OPTIONS_TOPIC: build_options_page, IMPLEMENTS_TOPIC: build_implements_page}
"""Topics whose pages are made: from the request model, and from the table of drafts."""
FILE_TYPES = {".png": "image/png", ".conf": "text/plain", ".service": "text/plain", "": "text/plain"}
LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?://|#)([^)\s]+)\)")
MAX_QUERY_CHARACTERS = 80


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
