"""The sample fields that ship with the distribution."""

from __future__ import annotations

from importlib import resources

from fields.errors import FieldError

SAMPLE_SUFFIX = ".geojson"


def list_sample_names() -> tuple[str, ...]:
    """Names of the sample fields, in alphabetical order."""
    files = [entry.name for entry in (resources.files("fields") / "samples").iterdir()]
    return tuple(sorted(file.removesuffix(SAMPLE_SUFFIX) for file in files if file.endswith(SAMPLE_SUFFIX)))


def read_sample_text(name: str) -> str:
    """GeoJSON text of one sample field; raises FieldError where there is no sample with that name."""
    if name not in list_sample_names():
        raise FieldError(f"'{name}' is not a sample field; choose one of {', '.join(list_sample_names())}.")
    return (resources.files("fields") / "samples" / f"{name}{SAMPLE_SUFFIX}").read_text(encoding="utf-8")
