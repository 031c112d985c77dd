"""What answers look like."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

Scope = Literal["read", "control", "admin"]
Status = Literal["queued", "running", "done", "failed", "cancelled"]


class Answer(BaseModel):
    """An answer, made from whatever has attributes of the same names."""

    model_config = ConfigDict(from_attributes=True)


class Refusal(Answer):
    """Why something is not done: one sentence, and the parameter it is about where it is about one."""

    error: str
    parameter: str | None = None


class Health(Answer):
    """That the service runs."""

    status: Literal["ok"] = "ok"
    version: str
    tokens_needed: bool


class FileAnswer(Answer):
    """A file by its name; a `sample` comes with Headland, `options` say how a field is read (crs, swap, local)."""

    kind: str
    name: str
    suffix: str
    size: int
    media: str
    created: str | None
    sample: bool = False
    options: dict[str, Any] = {}


class FileList(Answer):
    """Files, those that come with Headland first."""

    items: list[FileAnswer]


class Progress(Answer):
    """How far a job is: so many done of all, and what it is at in words."""

    done: int
    all: int
    words: str


class JobAnswer(Answer):
    """A job; `error` says in one sentence why it failed, `results` are the names of its files."""

    id: str
    kind: str
    name: str
    status: Status
    progress: Progress
    error: str | None
    created: str
    finished: str | None
    request: dict[str, Any]
    results: list[str]


class JobList(Answer):
    """Jobs, the newest first."""

    items: list[JobAnswer]


class ViewAnswer(Answer):
    """Where a result is shown once, below /api/v1."""

    path: str


class TokenAnswer(Answer):
    """A token by its name."""

    name: str
    scope: Scope
    created: str


class TokenList(Answer):
    """Tokens, the oldest first."""

    items: list[TokenAnswer]


class NewToken(Answer):
    """A token that was made; its text is shown this once."""

    name: str
    scope: Scope
    token: str


class EventAnswer(Answer):
    """Who did what, and when (UTC)."""

    id: int
    time: str
    fleet: str | None
    who: str
    what: str
    data: dict[str, Any]


class EventList(Answer):
    """Events, the oldest first."""

    items: list[EventAnswer]


_MEANING = {
    401: "No token, or one that is not known",
    403: "The scope of the token does not reach",
    404: "Nothing of that name",
    405: "Not by this method",
    409: "A name is taken, or a state stands in the way",
    413: "Too many bytes",
    422: "A value that cannot be used",
    429: "Too many requests, or too many jobs waiting",
    503: "The database cannot be used",
}


def refusals(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Refusals of a route for its documentation, with those that every route has."""
    return {each: {"model": Refusal, "description": _MEANING[each]} for each in sorted({*statuses, 413, 429, 503})}


READS = refusals(401, 403, 422)
"""Refusals of a route that reads."""
