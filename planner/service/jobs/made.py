"""Results as bytes with their names and media types."""

from __future__ import annotations

from planner.service.store.jobs import Made


def json_of(name: str, text: str) -> Made:
    """A JSON file."""
    return name, text.encode(), "application/json"


def csv_of(name: str, text: str) -> Made:
    """A CSV file."""
    return name, text.encode(), "text/csv; charset=utf-8"


def html_of(name: str, text: str) -> Made:
    """A page."""
    return name, text.encode("utf-8", "replace"), "text/html; charset=utf-8"


def png_of(name: str, content: bytes) -> Made:
    """A picture."""
    return name, content, "image/png"


def toml_of(name: str, text: str) -> Made:
    """A TOML file."""
    return name, text.encode(), "application/toml"
