"""Values of a farm file: limits, a default, and where the default is from."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field

SOURCE = "source"
NONE_GIVEN = "left open"


class Section(BaseModel):
    """A frozen part of a farm file that knows no other keys than its own."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def number(default: float | None, low: float, high: float, words: str, source: str = NONE_GIVEN) -> Any:
    """A number, neither true nor false, from `low` to `high`: what it is with its unit, and its default's source.

    The limits are wide: they keep out slips of the unit and of the sign.
    """
    return Field(
        default=default, ge=low, le=high, strict=True, allow_inf_nan=False, description=words,
        json_schema_extra={SOURCE: source},
    )  # fmt: skip


def other(default: Any, words: str, source: str = NONE_GIVEN, **rules: Any) -> Any:
    """A value of another kind, with pydantic's own rules."""
    return Field(default=default, description=words, json_schema_extra={SOURCE: source}, **rules)


def source_of(section: type[Section], key: str) -> str:
    """Where the default of a key is from."""
    extra = section.model_fields[key].json_schema_extra
    return str(extra[SOURCE]) if isinstance(extra, dict) and SOURCE in extra else NONE_GIVEN
