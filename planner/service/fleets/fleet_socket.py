"""The WebSocket of a fleet, with limits on frame rates and on links that have not sent connect yet.

A frame gets at most one refusal, and no frame of a client ends its link.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from fastapi import APIRouter
from pydantic import ValidationError
from starlette.status import WS_1000_NORMAL_CLOSURE, WS_1001_GOING_AWAY, WS_1008_POLICY_VIOLATION
from starlette.websockets import WebSocket, WebSocketDisconnect

from planner.errors import HeadlandError, render_refusal
from planner.fleet.session import inbound_frames
from planner.fleet.session.clients import CONTROL, TRACTOR, FleetClient, encode_frame
from planner.fleet.session.fleet_session import FleetSession
from planner.service.access.permissions import DRIVE, OPERATE, READ, identify_socket
from planner.service.errors import BusyError, ServiceError
from planner.service.fleets.fleet_sessions import FleetSessions
from planner.service.fleets.robot_client import REPLACED_CODE
from planner.service.gateway.connection_limits import (
    GREETED_SCOPE_KEY,
    ConnectionLimits,
    ConnectionRegistry,
    RateLimiter,
)
from planner.service.settings import LIMITS

CONNECT_TIMEOUT_S = 10.0
CROWDED_TEXT = "Too many links have not sent connect yet; link again and send it at once."
PENDING_LIMITS = ConnectionLimits(per_address=128, total=512, header_s=CONNECT_TIMEOUT_S)
"""Of links that have not sent connect yet."""
NORMAL_CODES = (WS_1000_NORMAL_CLOSURE, WS_1001_GOING_AWAY)
MOST_REFUSED = 10  # frames of a viewer before its link ends
FRAME_RATES = {TRACTOR: (200.0, 600.0), CONTROL: (60.0, 240.0)}  # per second, and at once
WATCHER_FRAME_RATES = (5.0, 20.0)
RIGHTS = {TRACTOR: DRIVE, CONTROL: OPERATE}  # of roles; others only read
FAULT_TEXT = "The service failed to do this because of a fault, see its log; it may not have been done."
TALKATIVE_TEXT = "This viewing link has sent {count} frames, which it may not; link again and only listen."


@contextmanager
def hold_place_until_connect(pending: ConnectionRegistry, address: str) -> Iterator[None]:
    """Hold a place among the `pending` links while the body waits for connect; the oldest of an address gives way.

    Raises BusyError if the place was given away.
    """
    task = asyncio.current_task()
    assert task is not None
    displaced = False

    def displace() -> None:
        nonlocal displaced
        displaced = True
        task.cancel()

    connection = pending.add_connection(address, displace)
    if connection is None:
        raise BusyError(CROWDED_TEXT)
    try:
        yield
    except asyncio.CancelledError:
        if not displaced:
            raise
        task.uncancel()
        raise BusyError(CROWDED_TEXT) from None
    finally:
        pending.remove_connection(connection)


link_router = APIRouter()


@link_router.websocket("/fleets/{id}/link")
async def link_client(websocket: WebSocket, id: str) -> None:
    """Link one client to a fleet until either side ends it."""
    sessions: FleetSessions = websocket.app.state.hub
    address = websocket.client.host if websocket.client else ""
    await websocket.accept()
    try:
        sessions.get_session(id)
        with hold_place_until_connect(websocket.app.state.greetings, address):
            client = await _await_connect(websocket, id)
        session = sessions.get_session(id)  # it may have been deleted meanwhile
        sessions.check_capacity(client)
        session.add_client(client, time.monotonic())
        if (release_place := websocket.scope.get(GREETED_SCOPE_KEY)) is not None:
            release_place()
    except (HeadlandError, ValidationError, TimeoutError) as refusal:
        await _refuse_connection(websocket, refusal)
        return
    except (WebSocketDisconnect, KeyError):
        return
    await _serve_client(websocket, session, client)


async def _await_connect(websocket: WebSocket, fleet: str) -> FleetClient:
    """Wait for connect and identify the client. Raises HeadlandError, ValidationError, TimeoutError."""
    async with asyncio.timeout(CONNECT_TIMEOUT_S):
        text = await _receive_text(websocket)
    if text is not None and len(text) > LIMITS.longest_connect_chars:
        raise ServiceError(
            f"The connect frame has {len(text)} characters; at most {LIMITS.longest_connect_chars} are allowed."
        )
    connect = inbound_frames.CONNECT.validate_json(text if text is not None else b"")
    who = await identify_socket(websocket, connect.token)
    who.check_right(RIGHTS.get(connect.role, READ), fleet, connect.tractor)
    number = None if connect.tractor is None else connect.tractor - 1
    name = f"{who.name} ({connect.name})" if connect.name else who.name  # in the log; fleets add a number
    if connect.role == TRACTOR:
        name = f"tractor {connect.tractor}"
    return FleetClient(connect.role, name, number, token=who.token_sha256)


async def _refuse_connection(websocket: WebSocket, refusal: Exception) -> None:
    if isinstance(refusal, ValidationError):
        sentence = inbound_frames.describe_frame_fault(refusal)
    elif isinstance(refusal, HeadlandError):
        sentence = render_refusal(refusal)
    else:
        sentence = f"No connect frame came within {CONNECT_TIMEOUT_S:g} s; send it first."
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):
        await websocket.send_text(encode_frame({"kind": "refused", "sentence": sentence, "sequence": None}))
        await websocket.close(WS_1008_POLICY_VIOLATION)


async def _serve_client(websocket: WebSocket, session: FleetSession, client: FleetClient) -> None:
    sending = asyncio.create_task(_send_waiting_frames(websocket, client))
    try:
        await _receive(websocket, session, client)
    except asyncio.CancelledError:  # the service ends
        return
    finally:
        sending.cancel()
        session.remove_client(client, time.monotonic())
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):
        await websocket.close()


async def _send_waiting_frames(websocket: WebSocket, client: FleetClient) -> None:
    """Send waiting frames until the client is expelled, replaced, or gone."""
    with contextlib.suppress(RuntimeError, WebSocketDisconnect, OSError):
        while (text := await client.outbox.take_next_frame()) is not None:
            await websocket.send_text(text)
        if client.expulsion_reason is not None:
            await websocket.send_text(
                encode_frame({"kind": "refused", "sentence": client.expulsion_reason, "sequence": None})
            )
        await websocket.close(REPLACED_CODE if client.expulsion_reason is None else WS_1008_POLICY_VIOLATION)


async def _receive(websocket: WebSocket, session: FleetSession, client: FleetClient) -> None:
    taken, allowance = 0, RateLimiter(*FRAME_RATES.get(client.role, WATCHER_FRAME_RATES))
    while not client.has_disconnected:
        taken += 1
        while not client.outbox.ended and (wait_s := allowance.take_token()) > 0.0:
            await asyncio.sleep(wait_s)  # frames that are not read yet stay with the sender
        if taken % LIMITS.frames_in_a_row == 0:
            await asyncio.sleep(0)  # one client must not occupy the loop
        try:
            text = await _receive_text(websocket)
        except (WebSocketDisconnect, RuntimeError) as end:
            client.has_disconnected = client.role != TRACTOR and getattr(end, "code", None) in NORMAL_CODES
            return
        if not client.outbox.ended:
            _handle_frame(session, client, text)


async def _receive_text(websocket: WebSocket) -> str | None:
    """The text of the next message, None for a binary one."""
    message = await websocket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code") or 1005)
    text = message.get("text")
    return text if isinstance(text, str) else None


def _handle_frame(session: FleetSession, client: FleetClient, text: str | None) -> None:
    """Handle one frame of a client; a wrong one is refused and changes nothing.

    Except for a tractor's obstacle report: that tractor is held, see planner.fleet.manager.obstacle_reports.
    """
    frame: Any = None
    try:
        if text is None:
            raise ServiceError("The frame is binary; send JSON as text.")
        if len(text) > inbound_frames.LARGEST_FRAME:
            raise ServiceError(
                f"The frame has {len(text)} characters; at most {inbound_frames.LARGEST_FRAME} are allowed."
            )
        frame = inbound_frames.FRAMES_OF_ROLE[client.role].validate_json(text)
        if isinstance(frame, inbound_frames.DisconnectFrame):
            client.has_disconnected = True
        elif isinstance(frame, inbound_frames.StateFrame):
            session.take_state(client, frame, time.monotonic())
        else:
            session.carry_out(client, frame, time.monotonic())
        return
    except ValidationError as error:
        sentence = inbound_frames.describe_frame_fault(error)
        if client.role not in (TRACTOR, CONTROL):
            sentence = f"A {client.role} only watches; it may send nothing but disconnect."
            client.refusals += 1
    except HeadlandError as refusal:
        sentence = render_refusal(refusal)
    except Exception:  # a fault of the service; the link stays, so that a stop can be sent
        logging.getLogger(__name__).exception("A frame of %s", client.who)
        sentence = FAULT_TEXT
    client.send({"kind": "refused", "sentence": sentence, "sequence": getattr(frame, "sequence", None)})
    if client.role == TRACTOR and text is not None and inbound_frames.is_about_obstacle(text):
        session.report_unreadable(client, sentence, time.monotonic())
    if client.refusals >= MOST_REFUSED:
        client.expel(TALKATIVE_TEXT.format(count=client.refusals))
