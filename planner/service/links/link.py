"""The WebSocket of a fleet: one frame in, at most one refusal out, and nothing that a client sends ends a stream."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from typing import Any

from fastapi import APIRouter
from pydantic import ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect

from planner.errors import HeadlandError
from planner.parameters import word_of
from planner.service.access import Who, who_of_socket
from planner.service.errors import ServiceError
from planner.service.links import frames
from planner.service.links.clients import CONTROL, TRACTOR, Client, packed
from planner.service.links.hub import Hub
from planner.service.links.live import LiveFleet
from planner.service.links.recording import check_time

HELLO_S = 10.0
REFUSED, REPLACED = 1008, 4001
NORMAL = (1000, 1001)
IN_A_ROW = 20  # frames of one client that others wait for
MOST_REFUSED = 100  # frames of a client that only watches, before its link ends
FAULT = "The service could not do this by a fault of its own, which is in its log; nothing may have happened."
TALKS = "A link that only watches has sent {count} frames that are not for it; link again and only listen."

router = APIRouter()


@router.websocket("/fleets/{id}/link")
async def link(websocket: WebSocket, id: str) -> None:
    """Link one client to a fleet until either side ends it."""
    hub: Hub = websocket.app.state.hub
    await websocket.accept()
    try:
        fleet = hub.fleet(id)
        client = await _greeted(websocket)
        fleet.join(client, time.monotonic())
    except (HeadlandError, ValidationError, TimeoutError) as refusal:
        await _turn_away(websocket, refusal)
        return
    except (WebSocketDisconnect, KeyError):
        return
    await _linked(websocket, fleet, client)


async def _greeted(websocket: WebSocket) -> Client:
    """The client that a hello makes, once it is known who it is. Raises what is refused."""
    text = await asyncio.wait_for(_text(websocket), HELLO_S)
    hello = frames.HELLO.validate_json(text if text is not None else b"")
    who = await asyncio.to_thread(who_of_socket, websocket, hello.token)
    who.check("control" if hello.role in (CONTROL, TRACTOR) else "read")
    number = None if hello.tractor is None else hello.tractor - 1
    return Client(hello.role, _name(who, hello), number, token=who.token)


def _name(who: Who, hello: frames.Hello) -> str:
    """What the log calls a client; a fleet numbers those of one name."""
    if hello.role == TRACTOR:
        return f"tractor {hello.tractor}"
    return f"{who.name} ({hello.name})" if hello.name else who.name


def _said(refusal: Exception) -> str:
    """A refusal as people read it: with the names that requests have for parameters."""
    return refusal.spoken(word_of) if isinstance(refusal, HeadlandError) else str(refusal)


async def _turn_away(websocket: WebSocket, refusal: Exception) -> None:
    if isinstance(refusal, ValidationError):
        sentence = frames.told_why(refusal)
    else:
        sentence = _said(refusal) or f"No hello came within {HELLO_S:g} s."
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):
        await websocket.send_text(packed({"kind": "refused", "sentence": sentence, "sequence": None}))
        await websocket.close(REFUSED)


async def _linked(websocket: WebSocket, fleet: LiveFleet, client: Client) -> None:
    sending = asyncio.create_task(_send(websocket, client))
    try:
        await _receive(websocket, fleet, client)
    finally:
        sending.cancel()
        fleet.leave(client, time.monotonic())
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):
        await websocket.close()


async def _send(websocket: WebSocket, client: Client) -> None:
    """Send what the client is to be told, until it is turned out, another link takes its place, or it is gone."""
    with contextlib.suppress(RuntimeError, WebSocketDisconnect, OSError):
        while (text := await client.outbox.take()) is not None:
            await websocket.send_text(text)
        if client.refused is not None:
            await websocket.send_text(packed({"kind": "refused", "sentence": client.refused, "sequence": None}))
        await websocket.close(REPLACED if client.refused is None else REFUSED)


async def _receive(websocket: WebSocket, fleet: LiveFleet, client: Client) -> None:
    taken = 0
    while not client.said_goodbye:
        taken += 1
        if taken % IN_A_ROW == 0:
            await asyncio.sleep(0)  # what waits to be read of one is never all that is done
        try:
            text = await _text(websocket)
        except (WebSocketDisconnect, RuntimeError) as end:
            client.said_goodbye = client.role != TRACTOR and getattr(end, "code", None) in NORMAL
            return
        if not client.outbox.ended:
            _take(fleet, client, text)


async def _text(websocket: WebSocket) -> str | None:
    """The text of the next message, None for a binary one."""
    message = await websocket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code") or 1005)
    text = message.get("text")
    return text if isinstance(text, str) else None


def _take(fleet: LiveFleet, client: Client, text: str | None) -> None:
    """One frame of a client; what is wrong with it is told, and nothing else happens.

    Save for a tractor that tells of an obstacle: it is held, see planner.service.centre.seeing.
    """
    frame: Any = None
    try:
        if text is None:
            raise ServiceError("The frame is binary; send JSON as text.")
        if len(text) > frames.LARGEST_FRAME:
            raise ServiceError(f"The frame has {len(text)} characters; at most {frames.LARGEST_FRAME} are taken.")
        frame = frames.OF_ROLE[client.role].validate_json(text)
        _carry_out(fleet, client, frame)
        return
    except ValidationError as error:
        sentence = frames.told_why(error)
        if client.role not in (TRACTOR, CONTROL):
            sentence = f"A {client.role} only watches; nothing but goodbye is taken of it."
            client.refusals += 1
    except HeadlandError as refusal:
        sentence = _said(refusal)
    except Exception:  # a fault of the service; whoever is linked keeps the link, and so can be told to stand
        logging.getLogger(__name__).exception("A frame of %s", client.who)
        sentence = FAULT
    _refuse(fleet, client, frame, text, sentence)


def _refuse(fleet: LiveFleet, client: Client, frame: Any, text: str | None, sentence: str) -> None:
    client.tell({"kind": "refused", "sentence": sentence, "sequence": getattr(frame, "sequence", None)})
    if client.role == TRACTOR and text is not None and frames.names_obstacle(text):
        fleet.unread(client, sentence, time.monotonic())
    if client.refusals >= MOST_REFUSED:
        client.turn_out(TALKS.format(count=client.refusals))


def _carry_out(fleet: LiveFleet, client: Client, frame: Any) -> None:
    if isinstance(frame, frames.Goodbye):
        client.said_goodbye = True
    elif isinstance(frame, frames.State):
        check_time(frame, time.time())
        fleet.reported(client, frame, time.monotonic())
    else:
        fleet.ordered(client, frame, time.monotonic())
