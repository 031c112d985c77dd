"""The document of the link, made from the models that frames are checked against (AsyncAPI 3.0)."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, get_args

from pydantic.json_schema import models_json_schema

from planner.service.links import frames, told

TAKEN: tuple[type[frames.Frame], ...] = (frames.Hello, frames.State, *get_args(frames.Orders), frames.Goodbye)
SCHEMAS = "#/components/schemas/{model}"
ROLES = (
    "The first frame is hello. A tractor sends state, obstacle and goodbye; an operator (control) every other frame; "
    "viewers and twins send nothing but goodbye. Tractors and operators need a token of the scope control, in the "
    "header Authorization or in hello. A frame that cannot be used is answered with refused and changes nothing; only "
    "a tractor that tells of an obstacle in it stands until an operator has looked or it tells of one that can be read."
)


@lru_cache(maxsize=1)
def document() -> dict[str, Any]:
    """The AsyncAPI document as plain values."""
    modes = [(model, "validation") for model in (*TAKEN, *told.TOLD)]
    _, schemas = models_json_schema(modes, ref_template=SCHEMAS)  # type: ignore[arg-type]
    messages = {model.__name__: _message(model) for model in (*TAKEN, *told.TOLD)}
    return {
        "asyncapi": "3.0.0",
        "info": {"title": "Headland fleet link", "version": str(frames.VERSION), "description": ROLES},
        "defaultContentType": "application/json",
        "channels": {
            "link": {
                "address": "/api/v1/fleets/{id}/link",
                "parameters": {"id": {"description": "The id of a fleet."}},
                "messages": {name: {"$ref": f"#/components/messages/{name}"} for name in messages},
            }
        },
        "operations": {
            "send": _operation("receive", TAKEN, "What clients send."),
            "receive": _operation("send", told.TOLD, "What the service sends."),
        },
        "components": {"messages": messages, "schemas": schemas["$defs"]},
    }


def _message(model: type[Any]) -> dict[str, Any]:
    kind = model.model_fields["kind"]
    word = kind.default if isinstance(kind.default, str) else get_args(kind.annotation)[0]
    payload = {"$ref": SCHEMAS.format(model=model.__name__)}
    return {"name": word, "title": model.__name__, "summary": (model.__doc__ or "").strip(), "payload": payload}


def _operation(action: str, models: tuple[type[Any], ...], summary: str) -> dict[str, Any]:
    return {
        "action": action, "summary": summary, "channel": {"$ref": "#/channels/link"},
        "messages": [{"$ref": f"#/channels/link/messages/{model.__name__}"} for model in models],
    }  # fmt: skip
