"""One live fleet: its centre, its clients and their frames. Nothing here waits for anybody.

The clock is that of planner.service.links.hub, which calls `step` twenty times a second.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from planner.service.centre.centre import Centre
from planner.service.centre.chances import Chances
from planner.service.centre.core import CENTRE
from planner.service.centre.errors import CentreError
from planner.service.centre.fleet_plan import FleetPlan, timing_of
from planner.service.centre.orders import Event, Order
from planner.service.centre.progress import progress_of
from planner.service.centre.remaining import check_still
from planner.service.centre.rules import Rules
from planner.service.centre.tractors import ONLINE
from planner.service.links import frames, telling
from planner.service.links.clients import CONTROL, TRACTOR, Client, packed
from planner.service.links.converting import metres_of, mission_told, place_told, report_of
from planner.service.links.freshness import Freshness, check_order
from planner.service.links.proposals import Proposals
from planner.service.links.recording import Recorder, row_of
from planner.service.links.twinning import OLDEST_S, Twins
from vehicle.plan_file import plan_to_json

PAINT_S, ALL_S = 1.0, 1.0
QUIET = ("command",)
"""Events that are kept and not shown as they happen."""
SETS_IN_MOTION = frozenset({"resume", "command"})
"""Orders that must not reach a tractor after an order to stand that was given later."""


def utc_now() -> str:
    """Now as frames have it."""
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


class LiveFleet:
    """A fleet that is driven. `begin_s` (seconds since 1970) is where the times of its recording begin.

    By tractor: `diagnoses` are the jobs asked for last, `findings` what they found, `doubted` the time of the doubt
    that was last diagnosed without being asked, `mended` the tractor file that its twin has instead of the plan's.
    """

    def __init__(
        self, id: str, name: str, plan: FleetPlan, rules: Rules, *, begin_s: float, way: str = "predict",
        deadline_s: float | None = None, chances: Chances | None = None, propose: Proposals | None = None,
    ) -> None:  # fmt: skip
        self.id, self.name, self.begin_s, self.deadline_at = id, name, begin_s, deadline_s
        self.chances = chances
        self.plan_text: str | None = None
        self.twins = Twins(plan, way, rules.times, begin_s)
        self.centre = Centre(plan, rules, self.twins)
        self.recorder = Recorder(id, plan.tractors)
        self.proposals = propose or Proposals()
        self.freshness = Freshness(rules.dead_man_s)
        self.on_order: Callable[[], None] | None = None  # to be called when somebody has ordered what must be kept
        self.clients: set[Client] = set()
        self.tractors: dict[int, Client] = {}
        self.events: list[tuple[str, Event]] = []
        self.again: set[int] = set()
        self.diagnoses: dict[int, str] = {}
        self.doubted: dict[int, float] = {}
        self.findings: dict[int, dict[str, Any]] = {}
        self.mended: dict[int, str] = {}
        self._links = 0
        self._times: list[str | None] = [None] * plan.tractors
        self._changed = set(range(plan.tractors))
        self._alarms = self._scene = -1
        self._painted = [0] * plan.tractors
        self._beat_s = self._painted_s = self._all_s = -math.inf

    @property
    def tractor_count(self) -> int:
        """Number of tractors."""
        return self.centre.plan.tractors

    # Clients

    def join(self, client: Client, now: float) -> None:
        """A client is linked: it is welcomed and told all there is. Raises CentreError for a tractor that is none."""
        number = client.tractor
        if client.role == TRACTOR:
            if number is None:
                raise CentreError("A tractor must say which one it is; give its number.", parameter="tractor")
            self.centre.check_number(number)
            before = self.tractors.get(number)
            if before is not None:
                before.outbox.end()
                self.clients.discard(before)
        else:
            self._links += 1
            client.who = f"{client.who} #{self._links}"
        self.clients.add(client)
        client.tell(self._welcome(client))
        if client.role == TRACTOR and number is not None:
            self.tractors[number] = client
            self.centre.joined(number, now)
            self.flush(urgent=False)  # what it is told first is its welcome
        else:
            self._show_all(client)

    def _welcome(self, client: Client) -> dict[str, Any]:
        number, rules = client.tractor, self.centre.rules
        welcome = {
            "kind": "welcome", "fleet": self.id, "role": client.role, "version": frames.VERSION,
            "tractor": None if number is None else number + 1, "last_sequence": -1, "server_time": utc_now(),
            "beat_s": rules.beat_s, "settings": rules.told(), "plan": None,
        }  # fmt: skip
        if client.role == TRACTOR and number is not None:
            welcome["last_sequence"] = self.recorder.seen[number]
            welcome["plan"] = mission_told(self.centre.plan, number)
            state = self.centre.states[number]
            welcome |= {"leg": state.leg, "leg_m": round(state.leg_m, 3)} | place_told(state.report, self.centre.plan)
        return welcome

    def _show_all(self, client: Client) -> None:
        """Everything that a page needs to begin with."""
        client.outbox.overflowed = False
        client.tell(telling.scene(self.centre, self.deadline_s()))
        for number in range(self.tractor_count):
            paint = telling.painted(self.centre, number, 0)
            if paint is not None:
                paint["points"] = paint["points"][: self._painted[number]]
                client.tell(paint)
        client.tell(self._alarms_told())
        for proposal in self.proposals.told():
            client.tell(proposal)
        client.outbox.put_newest(self._tick(range(self.tractor_count), time.monotonic()))

    def leave(self, client: Client, now: float) -> None:
        """A client's link is down."""
        self.clients.discard(client)
        if client.role == TRACTOR and client.tractor is not None and self.tractors.get(client.tractor) is client:
            del self.tractors[client.tractor]
            self.centre.left(client.tractor, now, client.said_goodbye)
            self._changed.add(client.tractor)
        if client.role == CONTROL:
            for number in self.centre.gone(client.who, now):
                self._tell_lease(number)
        self.flush()

    # What clients say

    def reported(self, client: Client, state: frames.State, now: float) -> None:
        """A state of a tractor. One that is known already is acknowledged once more and changes nothing."""
        number = client.tractor
        assert number is not None
        if state.sequence <= self.recorder.seen[number]:
            self.again.add(number)
            return
        self.recorder.check(number, state)
        age_s = time.time() - state.time.timestamp()
        report, old_s = report_of(state, self.centre.plan), age_s if age_s > OLDEST_S else 0.0
        self.centre.reported(number, report, now, old_s, delay_s=max(age_s, 0.0))
        self.recorder.add(number, row_of(state, self.begin_s, self.centre.rules.times))
        self.twins.reported(number, state, time.time())
        self._times[number] = state.time.isoformat(timespec="milliseconds").replace("+00:00", "Z")
        self._changed.add(number)

    def ordered(self, client: Client, frame: Any, now: float) -> None:
        """An order of an operator, or an obstacle that a tractor has seen. Raises CentreError."""
        carry_out: dict[type, Callable[[Client, Any, float], object]] = {
            frames.Drive: self._drive, frames.TakeLease: self._lease, frames.Leave: self._leave,
            frames.StopAll: lambda c, f, t: self.centre.stop_all(c.who, t),
            frames.Begin: lambda c, f, t: self._begin(c, f, t),
            frames.Pause: lambda c, f, t: self.centre.pause(c.who, _index(f.tractor), t),
            frames.GoOn: lambda c, f, t: self._go_on(c, f, t),
            frames.ObstacleSeen: self._obstacle,
            frames.Clear: lambda c, f, t: self.centre.clear(c.who, f.obstacle, t),
            frames.Acknowledge: self._acknowledge,
            frames.Fail: lambda c, f, t: self.centre.fail(c.who, f.tractor - 1, t),
            frames.Repaired: lambda c, f, t: self.centre.repaired(c.who, f.tractor - 1, t),
            frames.Replan: lambda c, f, t: self.replan(c.who, [n - 1 for n in f.without]),
            frames.Accept: lambda c, f, t: self.accept(c.who, f.proposal, t),
        }  # fmt: skip
        try:
            carry_out[type(frame)](client, frame, now)
        finally:
            self.flush()

    def _begin(self, client: Client, frame: frames.Begin, now: float) -> None:
        check_order(frame, time.time())
        self.centre.start(client.who, now)

    def _go_on(self, client: Client, frame: frames.GoOn, now: float) -> None:
        check_order(frame, time.time())
        self.centre.resume(client.who, _index(frame.tractor), now)

    def _acknowledge(self, client: Client, frame: frames.Acknowledge, now: float) -> None:
        if self.centre.faced_by(frame.alarm) is not None:  # it is an order to go on
            check_order(frame, time.time())
        self.centre.acknowledge(client.who, frame.alarm, now)

    def _drive(self, client: Client, frame: frames.Drive, now: float) -> None:
        speed = abs(frame.speed_command_mps) * frame.shuttle if frame.shuttle is not None else frame.speed_command_mps
        speed = 0.0 if frame.start == 0 else speed
        self.centre.check_number(frame.tractor - 1)
        self.centre.leases.check(frame.tractor - 1, client.who)
        self.freshness.check(frame, speed != 0.0, time.time())
        self.centre.command(client.who, frame.tractor - 1, math.radians(frame.steering_command_deg), speed, now)

    def _lease(self, client: Client, frame: frames.TakeLease, now: float) -> None:
        self.centre.lease(client.who, frame.tractor - 1, frame.takeover, now)
        self.freshness.leased(frame.tractor)
        self._tell_lease(frame.tractor - 1)

    def _leave(self, client: Client, frame: frames.Leave, now: float) -> None:
        self.centre.check_number(frame.tractor - 1)
        self.centre.leave(client.who, frame.tractor - 1, now)
        self._tell_lease(frame.tractor - 1)

    def _tell_lease(self, number: int) -> None:
        holder = self.centre.leases.holder(number)
        for client in self.clients:
            if client.role == CONTROL:
                client.tell({"kind": "lease", "tractor": number + 1, "holder": holder, "mine": holder == client.who})

    def _obstacle(self, client: Client, frame: frames.ObstacleSeen, now: float) -> None:
        ring = metres_of(self.centre.plan.saved, frame.polygon_m)
        self.centre.obstacle(client.who, ring, frame.name, now, client.tractor if client.role == TRACTOR else None)

    def unread(self, client: Client, sentence: str, now: float) -> None:
        """A tractor tells of an obstacle in a frame that is refused with this sentence: it stands."""
        assert client.tractor is not None
        self.centre.unreadable(client.tractor, sentence, now)
        self.flush()

    def replan(self, who: str, without: list[int]) -> int:
        """Ask for the rest of the work planned for the others; the number of the proposal. Raises CentreError."""
        for number in without:
            self.centre.check_number(number)
        number = self.proposals.ask(self.centre, without, time.monotonic(), self.show)
        self.centre.note(who, "replan", without=[each + 1 for each in without], proposal=number)
        return number

    def accept(self, who: str, proposal: int, now: float) -> None:
        """Go on by a proposal. Raises CentreError for one that is not ready, or too old."""
        rest, plan = self.proposals.plan(proposal)
        check_still(rest, self.centre, plan)
        self.centre.adopt(who, plan, now, rest.without)
        self.proposals.accepted(proposal, self.show)
        saved = self.centre.plan.saved
        self.plan_text = plan_to_json(
            saved.plan, crs=saved.crs, origin_m=saved.origin_m, scenario=saved.scenario, ground=saved.ground
        )
        self.twins.changed(self.centre.plan)

    # What is sent

    def show(self, frame: dict[str, Any]) -> None:
        """Send a frame to all who watch."""
        text = packed(frame)
        for client in self.clients:
            if client.watches:
                client.outbox.put(text)

    def flush(self, *, urgent: bool = True) -> None:
        """Send what the centre has to say; when `urgent`, orders to stand go before all that waits."""
        orders, events = self.centre.taken()
        for order in orders:
            self._send(order, urgent and order.kind == "stop")
        for event in events:
            self.events.append((utc_now(), event))
            if self.on_order is not None and event.who != CENTRE and event.what not in QUIET:
                self.on_order()
            if event.what not in QUIET:
                self.show({"kind": "event", "time": utc_now(), "who": event.who, "what": event.what,
                           "data": event.data})  # fmt: skip

    def _send(self, order: Order, first: bool) -> None:
        data, plan = dict(order.data), self.centre.plan
        if order.kind == "command":
            self.twins.commanded(order.tractor, data["steering_rad"], data["speed_mps"], time.time())
        client = self.tractors.get(order.tractor)
        if client is None:
            return
        if order.kind == "command":
            client.command_sequence += 1
            speed = data["speed_mps"]
            data = {
                "sequence": client.command_sequence, "speed_command_mps": round(speed, 3),
                "steering_command_deg": round(math.degrees(data["steering_rad"]), 3),
                "shuttle": 0 if speed == 0.0 else 1 if speed > 0.0 else -1, "start": int(speed != 0.0),
            }  # fmt: skip
        elif order.kind == "plan":
            data |= {"version": self.centre.version, "plan": mission_told(plan, order.tractor)}
        if first:
            client.outbox.withdraw(SETS_IN_MOTION)
        client.tell({"kind": order.kind} | data, first=first)

    def acknowledge(self, taken: Any) -> None:
        """Tell tractors up to which state theirs are kept, now that these are."""
        self.recorder.done(taken)
        for number in {number for number, _ in taken} | self.again:
            client = self.tractors.get(number)
            if client is not None and self.recorder.kept[number] >= 0:
                client.tell({"kind": "ack", "sequence": self.recorder.kept[number]})
        self.again = set()

    def step(self, now: float) -> None:
        """All that time brings about: twenty times a second."""
        self.centre.tick(now)
        self.twins.advance(now, time.time(), self.centre)
        self.flush()
        self._tell_anew()
        if now - self._beat_s >= self.centre.rules.beat_s - 0.01:
            self._beat_s = now
            beat = packed({"kind": "beat", "time": utc_now(), "clock_s": round(now, 3)})
            for client in self.tractors.values():
                client.outbox.put(beat)
        watchers = [client for client in self.clients if client.watches]
        self._seldom(watchers, now)
        if now - self._all_s >= ALL_S:
            self._all_s = now
            self._changed = set(range(self.tractor_count))
        if self._changed and watchers:
            text = self._tick(sorted(self._changed), now)
            for client in watchers:
                client.outbox.put_newest(text)
        self._changed = set()

    def close(self, sentence: str, now: float) -> None:
        """Nobody drives this fleet any more: its tractors are told to stand, and all links end."""
        self.proposals.close()
        for client in list(self.clients):
            client.turn_out(sentence)
            self.leave(client, now)

    def _tell_anew(self) -> None:
        """Tractors whose frames were too many to wait: what was dropped may have been an order to stand."""
        for number, client in self.tractors.items():
            if client.outbox.overflowed:
                client.outbox.overflowed = False
                self.centre.told_anew(number)
        self.flush(urgent=False)

    def _seldom(self, watchers: list[Client], now: float) -> None:
        """Scene, alarms and paint, when there is something new."""
        version = self.centre.version * 1000 + self.centre.obstacles.version
        if version != self._scene:
            self._scene = version
            self.show(telling.scene(self.centre, self.deadline_s()))
        if self.centre.alarms.version != self._alarms:
            self._alarms = self.centre.alarms.version
            self.show(self._alarms_told())
        if now - self._painted_s >= PAINT_S:
            self._painted_s = now
            for number in range(self.tractor_count):
                paint = telling.painted(self.centre, number, self._painted[number])
                if paint is not None:
                    self._painted[number] += len(paint["points"])
                    self.show(paint)
        for client in watchers:
            if client.outbox.overflowed:
                self._show_all(client)

    def _alarms_told(self) -> dict[str, Any]:
        clock, now = time.time(), time.monotonic()
        items = self.centre.alarms.told()
        for item in items:
            since = datetime.fromtimestamp(clock - (now - item["since"]), UTC)
            item["since"] = since.isoformat(timespec="seconds").replace("+00:00", "Z")
        return {"kind": "alarms", "items": items}

    def progress(self, now: float, clock_s: float) -> dict[str, Any]:
        """What has to outlive a restart. A plan that was made anew is kept with its timing, see `prepared`."""
        kept: dict[str, Any] = {
            "centre": progress_of(self.centre, now, clock_s), "plan": self.plan_text,
            "mended": {str(number): name for number, name in self.mended.items()},
        }  # fmt: skip
        return kept if self.plan_text is None else kept | {"timing": timing_of(self.centre.plan)}

    def deadline_s(self) -> float | None:
        """Seconds until the deadline; None without one."""
        return None if self.deadline_at is None else self.deadline_at - time.time()

    def _tick(self, numbers: Any, now: float) -> str:
        tractors = [telling.tractor_told(self.centre, number, now, self._times[number]) for number in numbers]
        for told in tractors:
            told |= self.twins.told(told["tractor"] - 1, told["connection"] == ONLINE)
        fleet = telling.fleet_told(self.centre, self.deadline_s(), self.chances)
        return packed({"kind": "tick", "time": utc_now(), "tractors": tractors, "fleet": fleet})


def _index(tractor: int | None) -> int | None:
    return None if tractor is None else tractor - 1
