"""Errors as answers: one sentence and the parameter it is about, never a traceback."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from sqlalchemy.exc import OperationalError
from starlette.exceptions import HTTPException
from starlette.routing import Match

from planner.errors import HeadlandError
from planner.service.faults import place_of, told_of

FAULT = "A fault of Headland; the log of the service has what happened. Please report it."
METHODS = ("DELETE", "GET", "HEAD", "OPTIONS", "PATCH", "POST", "PUT")


def answer(status: int, sentence: str, parameter: str | None = None, **headers: str) -> JSONResponse:
    """A refusal."""
    return JSONResponse({"error": sentence, "parameter": parameter}, status, headers)


def add_refusals(app: FastAPI, name_of: Callable[[str], str]) -> None:
    """Let an app answer errors this way; `name_of` gives parameters of the library the names of requests."""

    async def refused(_request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, HeadlandError)
        status = getattr(error, "http", 422)
        headers = {"www-authenticate": "Bearer"} if status == 401 else {}
        parameter = None if error.parameter is None else name_of(error.parameter)
        return answer(status, error.spoken(name_of), parameter, **headers)

    async def invalid(_request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, RequestValidationError)
        return answer(422, *_first(error.errors()))

    async def http(request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, HTTPException)
        return _of_http(app, request, error)

    async def lost(_request: Request, error: Exception) -> JSONResponse:
        logging.getLogger(__name__).error("The database: %s", error)
        return answer(503, "The database cannot be reached just now; ask again.")

    async def fault(_request: Request, _error: Exception) -> JSONResponse:
        return answer(500, FAULT)

    app.add_exception_handler(HeadlandError, refused)
    app.add_exception_handler(RequestValidationError, invalid)
    app.add_exception_handler(HTTPException, http)
    app.add_exception_handler(OperationalError, lost)
    app.add_exception_handler(Exception, fault)


def _of_http(app: FastAPI, request: Request, error: HTTPException) -> JSONResponse:
    headers = {name.lower(): value for name, value in (error.headers or {}).items()}
    if error.status_code == 404:
        return answer(404, "There is nothing at this address; /api/v1/docs shows what there is.")
    if error.status_code == 405:
        headers["allow"] = ", ".join(_allowed(app, request))
        return answer(405, f"This address does not take {request.method[:20]}; it takes {headers['allow']}.", **headers)
    if error.status_code == 400:
        return answer(422, "The body cannot be read; send JSON in UTF-8, or a form where a file is asked for.")
    return answer(error.status_code, str(error.detail), None, **headers)


def _allowed(app: FastAPI, request: Request) -> list[str]:
    """The methods that an address takes."""
    found = []
    for method in METHODS:
        scope = dict(request.scope) | {"method": method}
        if any(route.matches(scope)[0] == Match.FULL for route in app.router.routes):
            found.append(method)
    return found


def _first(faults: Any) -> tuple[str, str | None]:
    """The first fault of a request as a sentence, and its parameter."""
    fault = faults[0]
    if fault["type"] == "json_invalid":
        return told_of(fault, "The body"), None
    place = fault["loc"][1:]
    name = next((part for part in place if isinstance(part, str)), None)
    return told_of(fault, place_of(place) or f"The {fault['loc'][0]}"), name
