"""The sample fields that ship with the distribution."""

from __future__ import annotations

from importlib import resources

from fields.errors import FieldError

SUFFIX = ".geojson"


def sample_names() -> tuple[str, ...]:
    """Names of the sample fields, in alphabetical order."""
    files = [entry.name for entry in (resources.files("fields") / "samples").iterdir()]
    return tuple(sorted(file.removesuffix(SUFFIX) for file in files if file.endswith(SUFFIX)))


def sample_text(name: str) -> str:
    """GeoJSON text of one sample field.

    Raises:
        FieldError: there is no sample of that name.
    """
    if name not in sample_names():
        raise FieldError(f"'{name}' is not a sample field; choose one of {', '.join(sample_names())}.")
    return (resources.files("fields") / "samples" / f"{name}{SUFFIX}").read_text(encoding="utf-8")
