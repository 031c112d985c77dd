"""One live fleet: its fleet manager, its clients and their frames. Nothing here blocks.

The caller is the clock: it calls `step` twenty times a second.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Any, assert_never

from planner.fleet.manager.finish_forecast import FinishDistribution
from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.manager.fleet_state import FLEET_MANAGER
from planner.fleet.manager.progress_snapshot import capture_progress
from planner.fleet.manager.remaining_work import check_proposal_still_fits
from planner.fleet.model.alarms import CRITICAL
from planner.fleet.model.fleet_plan import FleetPlan, describe_timing
from planner.fleet.model.rules import REFRESH_PERIOD_S, FleetManagerError, FleetRules
from planner.fleet.model.tractor_state import ONLINE, FleetEvent, TractorOrder
from planner.fleet.replanning.proposals import ReplanProposals
from planner.fleet.session import frame_content, inbound_frames
from planner.fleet.session.clients import CONTROL, TRACTOR, FleetClient, encode_frame
from planner.fleet.session.fleet_twins import OLDEST_STATE_S, FleetTwins
from planner.fleet.session.frame_content import (
    build_antenna_pose_values,
    build_report,
    describe_mission,
)
from planner.fleet.session.frame_timing import (
    CommandFreshness,
    TractorClock,
    check_order_fresh,
    describe_offset,
    format_utc,
)
from planner.fleet.session.state_recorder import MOST_WAITING_STATES, StateRecorder, build_row
from vehicle.missions.plan_file import format_plan

FULL_TICK_PERIOD_S = 0.5  # pages show data older than a second as old
UNRECORDED = "unrecorded"  # nothing is saved at present, so a restart would lose it
UNSAVED_ALARM_S = 10.0  # without saving, after which an alarm is raised
MOST_EVENTS = 5000  # that wait to be saved
CLOCK_ALARM_S = 1.0  # for which a clock must be wrong before an alarm
QUIET_EVENTS = ("command",)
"""Events that are saved but not sent to pages."""
SETS_IN_MOTION = frozenset({"resume", "command"})
"""Orders that a later stop withdraws if they are not sent yet."""


class FleetSession:
    """A live fleet. The times of its recording start at `begin_s` (seconds since 1970).

    By tractor: `diagnoses` are the last diagnosis jobs, `findings` their results, `diagnosed_doubts` the times of the
    last doubts that were diagnosed automatically, `twin_files` the tractor files that twins use instead of the plan's.
    """

    def __init__(
        self,
        id: str,
        name: str,
        plan: FleetPlan,
        rules: FleetRules,
        *,
        begin_s: float,
        twin_method: str = "predict",
        deadline_s: float | None = None,
        finish_distribution: FinishDistribution | None = None,
        proposals: ReplanProposals | None = None,
    ) -> None:
        self.id, self.name, self.begin_s, self.deadline_unix_s = id, name, begin_s, deadline_s
        self.finish_distribution = finish_distribution
        self.plan_text: str | None = None
        self.twins = FleetTwins(plan, twin_method, rules.times, begin_s)
        self.manager = FleetManager(plan, rules, self.twins)
        self.recorder = StateRecorder(id, plan.tractor_count)
        self.proposals = proposals or ReplanProposals()
        self.freshness = CommandFreshness(rules.dead_man_s)
        self.on_stop: Callable[[float], None] | None = None  # called with the seconds that an order to stop took
        self.on_order: Callable[[], None] | None = None  # called when an order must be saved
        self.clients: set[FleetClient] = set()
        self.tractors: dict[int, FleetClient] = {}
        self.events: list[tuple[str, FleetEvent]] = []
        self._saved_at_s: float | None = None
        self.repeated_numbers: set[int] = set()
        self.diagnoses: dict[int, str] = {}
        self.diagnosed_doubts: dict[int, float] = {}
        self.findings: dict[int, dict[str, Any]] = {}
        self.twin_files: dict[int, str] = {}
        self.clocks = [TractorClock() for _ in range(plan.tractor_count)]
        self._link_count = 0
        self._state_times_s: list[float | None] = [None] * plan.tractor_count
        self._changed = set(range(plan.tractor_count))
        self._alarms_version = self._scene_version = -1
        self._coverage_sent = [0] * plan.tractor_count
        self._heartbeat_at_s = self._coverage_at_s = self._full_tick_at_s = -math.inf

    @property
    def tractor_count(self) -> int:
        """Number of tractors."""
        return self.manager.plan.tractor_count

    # Clients

    def add_client(self, client: FleetClient, now: float) -> None:
        """Welcome a new client and send it the present state. Raises FleetManagerError for an unknown tractor."""
        number = client.tractor
        if client.role == TRACTOR:
            if number is None:
                raise FleetManagerError("A tractor needs its number; send it as tractor.", parameter="tractor")
            self.manager.check_tractor_number(number)
            previous = self.tractors.get(number)
            if previous is not None:  # another link claims to be this tractor
                stop = {"kind": "stop", "reason": "another link took the place of this tractor"}
                previous.outbox.end_with_frame(encode_frame(stop))
                self.clients.discard(previous)
                self.manager.warn_of_replaced_link(number, now)
        else:
            self._link_count += 1
            client.who = f"{client.who} #{self._link_count}"
        self.clients.add(client)
        client.send(self._build_welcome(client))
        if client.role == TRACTOR and number is not None:
            self.tractors[number] = client
            self.clocks[number].note_new_link()
            self.manager.connect_tractor(number, now)
            self.send_pending_outputs(urgent=False)  # its welcome comes first
        else:
            self._send_full_view(client)

    def _build_welcome(self, client: FleetClient) -> dict[str, Any]:
        number, rules = client.tractor, self.manager.rules
        welcome = {
            "kind": "welcome",
            "fleet": self.id,
            "role": client.role,
            "version": inbound_frames.VERSION,
            "tractor": None if number is None else number + 1,
            "last_sequence": -1,
            "server_time": format_utc(),
            "clock_s": round(time.monotonic(), 3),
            "heartbeat_s": rules.heartbeat_s,
            "settings": asdict(rules),
            "plan": None,
        }
        if client.role == TRACTOR and number is not None:
            welcome["last_sequence"] = self.recorder.received[number]
            welcome["plan"] = describe_mission(self.manager.plan, number)
            state = self.manager.states[number]
            welcome |= {"leg": state.leg, "leg_m": round(state.leg_m, 3)} | build_antenna_pose_values(
                state.report, self.manager.plan
            )
        return welcome

    def _send_full_view(self, client: FleetClient) -> None:
        """Send a page everything it needs to start."""
        client.outbox.overflowed = False
        client.send(frame_content.build_scene(self.manager, self.compute_deadline_s()))
        for number in range(self.tractor_count):
            coverage = frame_content.build_coverage(self.manager, number, 0)
            if coverage is not None:
                coverage["points"] = coverage["points"][: self._coverage_sent[number]]
                client.send(coverage)
        client.send(frame_content.build_alarms(self.manager))
        for proposal in self.proposals.list_frames():
            client.send(proposal)
        client.outbox.replace_waiting_tick(self._build_tick(range(self.tractor_count), time.monotonic()))

    def remove_client(self, client: FleetClient, now: float) -> None:
        """A client's link is down."""
        self.clients.discard(client)
        if client.role == TRACTOR and client.tractor is not None and self.tractors.get(client.tractor) is client:
            del self.tractors[client.tractor]
            self.manager.disconnect_tractor(client.tractor, now, client.has_disconnected)
            self._changed.add(client.tractor)
        if client.role == CONTROL:
            for number in self.manager.operators.disconnect_operator(client.who, now):
                self._send_lease(number)
        self.send_pending_outputs()

    # Frames of clients

    def take_state(self, client: FleetClient, state: inbound_frames.StateFrame, now: float) -> None:
        """Take a state of a tractor; a repeated one is only acknowledged again."""
        number = client.tractor
        assert number is not None
        if state.sequence <= self.recorder.received[number]:
            self.repeated_numbers.add(number)
            return
        self.recorder.check_state_sequence(number, state)
        reading = self.clocks[number].date_state(state.time.timestamp(), time.time(), now, state.heartbeat_s)
        self._check_clock(number, state.heartbeat_s is not None, now)
        report = build_report(state, self.manager.plan, reading.time_s)
        late_s = reading.age_s if reading.age_s > OLDEST_STATE_S else 0.0
        self.manager.take_report(number, report, now, late_s, delay_s=reading.age_s, unsure_s=reading.unsure_s)
        self.recorder.add(number, build_row(state, self.twins.compute_time_s(reading.time_s)))
        self.twins.take_state(number, state, reading.time_s, time.time())
        self._state_times_s[number] = reading.time_s
        self._changed.add(number)

    def _check_clock(self, number: int, is_echoed: bool, now: float) -> None:
        """Update the alarm of a tractor's wrong clock."""
        clock = self.clocks[number]
        if not clock.offset_s:
            clock.reported_s = None
            self.manager.update_clock_alarm(number, None, is_echoed, now)
        elif now - clock.since_s >= CLOCK_ALARM_S and clock.reported_s != clock.since_s:
            clock.reported_s = clock.since_s
            self.manager.update_clock_alarm(number, describe_offset(clock.offset_s), is_echoed, now)

    def carry_out(self, client: FleetClient, frame: Any, now: float) -> None:
        """Carry out an order of an operator, or an obstacle report of a tractor. Raises FleetManagerError."""
        try:
            self._pass_on_order(client, frame, now)
        finally:
            self.send_pending_outputs()
        if isinstance(frame, inbound_frames.StopAllFrame) and self.on_stop is not None:
            self.on_stop(time.monotonic() - now)

    def _pass_on_order(self, client: FleetClient, frame: inbound_frames.OrderFrame, now: float) -> None:
        who, operators, obstacle_reports = client.who, self.manager.operators, self.manager.obstacle_reports
        match frame:
            case inbound_frames.StopAllFrame():
                operators.stop_all(who, now)
            case inbound_frames.CommandFrame():
                self._forward_remote_command(client, frame, now)
            case inbound_frames.TakeLeaseFrame():
                operators.take_lease(who, frame.tractor - 1, frame.takeover, now)
                self.freshness.reset(frame.tractor)
                self._send_lease(frame.tractor - 1)
            case inbound_frames.ReturnLeaseFrame():
                self.manager.check_tractor_number(frame.tractor - 1)
                operators.return_lease(who, frame.tractor - 1, now)
                self._send_lease(frame.tractor - 1)
            case inbound_frames.StartFrame():
                check_order_fresh(frame, time.time())
                operators.start_fleet_work(who, now)
            case inbound_frames.PauseFrame():
                operators.pause_tractors(who, _convert_to_index(frame.tractor), now)
            case inbound_frames.ResumeFrame():
                check_order_fresh(frame, time.time())
                operators.resume_tractors(who, _convert_to_index(frame.tractor), now)
            case inbound_frames.ObstacleFrame():
                east, north = self.manager.plan.saved.origin_m
                ring = tuple((x - east, y - north) for x, y in frame.polygon_m)
                reporting_tractor = client.tractor if client.role == TRACTOR else None
                obstacle_reports.add(who, ring, frame.name, now, reporting_tractor)
            case inbound_frames.ClearFrame():
                obstacle_reports.clear(who, frame.obstacle, now)
            case inbound_frames.AcknowledgeFrame():
                held_number = obstacle_reports.find_tractor_held_by_alarm(frame.alarm)
                if held_number is not None or self.manager.dangers.is_answered_by(frame.alarm):  # it resumes tractors
                    check_order_fresh(frame, time.time())
                obstacle_reports.acknowledge_alarm(who, frame.alarm, now)
            case inbound_frames.FailFrame():
                operators.mark_failed(who, frame.tractor - 1, now)
            case inbound_frames.RecoverFrame():
                operators.mark_repaired(who, frame.tractor - 1, now)
            case inbound_frames.ReplanFrame():
                self.replan(who, [number - 1 for number in frame.without])
            case inbound_frames.AcceptFrame():
                self.accept_proposal(who, frame.proposal, now)
            case _:
                assert_never(frame)

    def _forward_remote_command(self, client: FleetClient, frame: inbound_frames.CommandFrame, now: float) -> None:
        speed_mps = 0.0 if frame.start == 0 else frame.speed_command_mps
        if frame.shuttle is not None:
            speed_mps = abs(speed_mps) * frame.shuttle
        self.manager.check_lease(frame.tractor - 1, client.who)
        self.freshness.check_command_fresh(frame, speed_mps != 0.0, time.time())
        self.manager.operators.send_command(
            client.who, frame.tractor - 1, math.radians(frame.steering_command_deg), speed_mps, now
        )

    def _send_lease(self, number: int) -> None:
        holder = self.manager.lease_holders.get(number)
        for client in self.clients:
            if client.role == CONTROL:
                client.send(
                    {"kind": "lease", "tractor": number + 1, "holder": holder, "is_yours": holder == client.who}
                )

    def report_unreadable(self, client: FleetClient, sentence: str, now: float) -> None:
        """Stop a tractor whose obstacle frame was refused with this sentence."""
        assert client.tractor is not None
        self.manager.obstacle_reports.add_unreadable(client.tractor, sentence, now)
        self.send_pending_outputs()

    def replan(self, who: str, without: list[int]) -> int:
        """Plan all work that is left anew without some tractors; returns the proposal's number.

        Raises FleetManagerError.
        """
        for number in without:
            self.manager.check_tractor_number(number)
        number = self.proposals.start_replanning(self.manager, without, time.monotonic(), self.broadcast)
        self.manager.log_event(who, "replan", without=[excluded + 1 for excluded in without], proposal=number)
        return number

    def accept_proposal(self, who: str, proposal: int, now: float) -> None:
        """Accept a proposal. Raises FleetManagerError if it is not ready, or outdated."""
        remaining, plan = self.proposals.get_ready_proposal(proposal)
        check_proposal_still_fits(remaining, self.manager, plan)
        self.manager.operators.adopt_plan(who, plan, now, remaining.excluded)
        self.proposals.mark_accepted(proposal, self.broadcast)
        saved = self.manager.plan.saved
        self.plan_text = format_plan(
            saved.plan, crs=saved.crs, origin_m=saved.origin_m, scenario=saved.scenario, ground=saved.ground
        )
        self.twins.plan = self.manager.plan

    # Frames to clients

    def broadcast(self, frame: dict[str, Any]) -> None:
        """Send a frame to all watchers."""
        text = encode_frame(frame)
        for client in self.clients:
            if client.is_watcher:
                client.outbox.put_frame(text)

    def send_pending_outputs(self, *, urgent: bool = True) -> None:
        """Send pending orders and events; when `urgent`, orders to stop go before all waiting frames."""
        orders, events = self.manager.take_outputs()
        for order in orders:
            self._send_order(order, urgent and order.kind == "stop")
        for event in events:
            self.events.append((format_utc(), event))
            del self.events[:-MOST_EVENTS]
            if self.on_order is not None and event.who != FLEET_MANAGER and event.what not in QUIET_EVENTS:
                self.on_order()
            if event.what not in QUIET_EVENTS:
                self.broadcast({"kind": "event", "time": format_utc(), **asdict(event)})

    def _send_order(self, order: TractorOrder, is_first: bool) -> None:
        data, plan = dict(order.data), self.manager.plan
        if order.kind == "command":
            self.twins.take_command(order.tractor, data["steering_rad"], data["speed_mps"], time.time())
        client = self.tractors.get(order.tractor)
        if client is None:
            return
        if order.kind == "command":
            client.command_sequence += 1
            speed_mps = data["speed_mps"]
            data = {
                "sequence": client.command_sequence,
                "speed_command_mps": round(speed_mps, 3),
                "steering_command_deg": round(math.degrees(data["steering_rad"]), 3),
                "shuttle": 0 if speed_mps == 0.0 else 1 if speed_mps > 0.0 else -1,
                "start": int(speed_mps != 0.0),
            }
        elif order.kind == "plan":
            data |= {"version": self.manager.version, "plan": describe_mission(plan, order.tractor)}
        if is_first:
            client.outbox.drop_frames_of_kinds(SETS_IN_MOTION)
        client.send({"kind": order.kind} | data, first=is_first)

    def acknowledge_states(self, taken: Any) -> None:
        """Acknowledge states to tractors after they were saved."""
        self.recorder.mark_saved(taken)
        for number in {number for number, _ in taken} | self.repeated_numbers:
            client = self.tractors.get(number)
            if client is not None and self.recorder.saved[number] >= 0:
                client.send({"kind": "ack", "sequence": self.recorder.saved[number]})
        self.repeated_numbers = set()

    def mark_saved(self, now: float) -> None:
        """Note that everything was saved."""
        self._saved_at_s = now
        if self.manager.alarms.is_alarm_on(UNRECORDED, None):
            self.manager.alarms.end_alarm(UNRECORDED, None)
            self.manager.log_event(FLEET_MANAGER, "recorded again", states_lost=self.recorder.lost)
        self.recorder.lost = 0

    def check_saving(self, now: float, clock_s: float) -> None:
        """Raise an alarm if nothing could be saved for UNSAVED_ALARM_S."""
        self._saved_at_s = now if self._saved_at_s is None else self._saved_at_s
        silent_s = now - self._saved_at_s
        if silent_s < UNSAVED_ALARM_S:
            return
        since = format_utc(clock_s - silent_s, "seconds")
        sentence = f"The database has been unreachable since {since}; nothing is recorded."
        if self.recorder.lost:
            sentence += f" Only the last {MOST_WAITING_STATES} states per tractor are kept; older ones are lost."
        self.manager.raise_alarm(UNRECORDED, None, CRITICAL, sentence, now)

    def step(self, now: float) -> None:
        """Do everything that depends on time; to be called twenty times a second."""
        self.manager.update_fleet(now)
        self.twins.advance(now, time.time(), self.manager)
        self.send_pending_outputs()
        self._resend_dropped()
        if now - self._heartbeat_at_s >= self.manager.rules.heartbeat_s - 0.01:
            self._heartbeat_at_s = now
            heartbeat = encode_frame({"kind": "heartbeat", "time": format_utc(), "clock_s": round(now, 3)})
            for client in self.tractors.values():
                client.outbox.put_frame(heartbeat)
        watchers = [client for client in self.clients if client.is_watcher]
        self._send_changed_views(watchers, now)
        if now - self._full_tick_at_s >= FULL_TICK_PERIOD_S:
            self._full_tick_at_s = now
            self._changed = set(range(self.tractor_count))
        if self._changed and watchers:
            text = self._build_tick(sorted(self._changed), now)
            for client in watchers:
                client.outbox.replace_waiting_tick(text)
        self._changed = set()

    def close(self, sentence: str, now: float) -> None:
        """Stop all tractors and end all links."""
        self.proposals.cancel_replanning()
        for client in list(self.clients):
            client.expel(sentence)
            self.remove_client(client, now)

    def _resend_dropped(self) -> None:
        """Send orders again to tractors whose outbox overflowed: a stop may have been dropped."""
        for number, client in self.tractors.items():
            if client.outbox.overflowed:
                client.outbox.overflowed = False
                self.manager.resend_orders(number)
        self.send_pending_outputs(urgent=False)

    def _send_changed_views(self, watchers: list[FleetClient], now: float) -> None:
        """Send scene, alarms and coverage when they have changed."""
        if self.manager.scene_version != self._scene_version:
            self._scene_version = self.manager.scene_version
            self.broadcast(frame_content.build_scene(self.manager, self.compute_deadline_s()))
        if self.manager.alarms.version != self._alarms_version:
            self._alarms_version = self.manager.alarms.version
            self.broadcast(frame_content.build_alarms(self.manager))
        if now - self._coverage_at_s >= REFRESH_PERIOD_S:
            self._coverage_at_s = now
            for number in range(self.tractor_count):
                coverage = frame_content.build_coverage(self.manager, number, self._coverage_sent[number])
                if coverage is not None:
                    self._coverage_sent[number] += len(coverage["points"])
                    self.broadcast(coverage)
        for client in watchers:
            if client.outbox.overflowed:
                self._send_full_view(client)

    def capture_progress(self, now: float, clock_s: float) -> dict[str, Any]:
        """The state to save for a restart; a replanned plan with its timing, see `prepare_fleet_plan`."""
        saved: dict[str, Any] = {
            "centre": capture_progress(self.manager, now, clock_s),
            "plan": self.plan_text,
            "mended": {str(number): name for number, name in self.twin_files.items()},
        }
        return saved if self.plan_text is None else saved | {"timing": describe_timing(self.manager.plan)}

    def compute_deadline_s(self) -> float | None:
        """Seconds until the deadline; None without one."""
        return None if self.deadline_unix_s is None else self.deadline_unix_s - time.time()

    def _build_tick(self, numbers: Any, now: float) -> str:
        build, times_s = frame_content.build_tick_tractor, self._state_times_s
        tractors = [build(self.manager, number, now, times_s[number]) for number in numbers]
        for tractor in tractors:
            tractor |= self.twins.build_tick_entries(tractor["tractor"] - 1, tractor["connection"] == ONLINE)
        fleet = frame_content.build_tick_fleet(self.manager, self.compute_deadline_s(), self.finish_distribution)
        return encode_frame({"kind": "tick", "time": format_utc(), "tractors": tractors, "fleet": fleet})


def _convert_to_index(tractor: int | None) -> int | None:
    return None if tractor is None else tractor - 1
