"""Timing of frames: the clock offset of each tractor, so that states get the service's time, and the age of orders.

The lag of a state (arrival minus its time) is the clock offset plus the transit time. The two are told apart like this:

- No transit time is negative: a state from the future shows a clock that is ahead, at least by that much.
- States of a link arrive in order. The transit time cannot grow by more than the time between two arrivals; a lag that
  jumps by more shows a clock that was set back.
- A tractor that echoes the clock of its last heartbeat (`heartbeat_s` of a state) made the state after that heartbeat
  was sent, as in NTP: any lag beyond the time since then is clock offset.
- Without an echo, a lag that is there from the first state of a link and constant for SETTLED_S counts as clock offset,
  and one of more than OLDEST_S at once, as no tractor keeps states so long. A lag that grew is a slow link.

Only clocks that are off by more than SLOW_CLOCK_S or FAST_CLOCK_S are corrected and reported. From then on the fastest
state shows the offset. A clock corrected without an echo may still be a slow link, so remote control is refused: the
greatest age of its states (`unsure_s`) is unknown.

Orders that arrive late must not set a tractor in motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from planner.fleet.model.rules import FleetManagerError
from planner.fleet.session.inbound_frames import AcknowledgeFrame, CommandFrame, ResumeFrame, StartFrame

SLOW_CLOCK_S, FAST_CLOCK_S = 4.0, 2.0
OLDEST_S = 900.0
SETTLED_S, SPREAD_S = 5.0, 0.5
TOLERANCE_S = 1.0  # of a jump that shows that a clock was set
UNKNOWN_S = 3600.0  # greatest age assumed for a state of unknown age
CLOCK_JUMP_S = 0.5  # between the clock and the monotonic clock: somebody has set the clock
LATEST_ECHO_S = 600.0  # of a heartbeat that this service may have sent
FUTURE_TOLERANCE_S = 0.5  # by which a client's clock may be ahead of the service's
ORDER_AGE_S = 2.0  # age up to which an order to resume is carried out


@dataclass(frozen=True)
class StateTiming:
    """The time of a state by the clock of the service (seconds since 1970), its age, and how much older it may be."""

    time_s: float
    age_s: float
    unsure_s: float = 0.0


class TractorClock:
    """The clock of one tractor; `offset_s` is to be added to its times, 0 if it is accurate enough."""

    def __init__(self) -> None:
        self.offset_s = 0.0
        self.since_s = 0.0  # when it was last found wrong, or right again
        self.reported_s: float | None = None  # of which `since_s` an alarm tells
        self._previous: tuple[float, float] | None = None
        self._begun_s: float | None = None
        self._least_s = self._most_s = 0.0
        self._was_quick = False

    def note_new_link(self) -> None:
        """A new link of the tractor: states that waited for it come late."""
        self._previous, self._begun_s, self._was_quick = None, None, False

    def date_state(self, time_s: float, clock_s: float, now: float, heartbeat_s: float | None = None) -> StateTiming:
        """Date a state of `time_s` that came at `clock_s` (both since 1970), or `now` by the clock of heartbeats."""
        lag_s = clock_s - time_s
        bound_s = None if heartbeat_s is None or not 0.0 <= now - heartbeat_s <= LATEST_ECHO_S else now - heartbeat_s
        late_s = lag_s - self.offset_s
        if late_s < -FAST_CLOCK_S or (late_s > SLOW_CLOCK_S and self._is_lag_from_clock(lag_s, late_s, bound_s, now)):
            # within the limits counts as none
            offset_s = 0.0 if -FAST_CLOCK_S <= lag_s <= SLOW_CLOCK_S else lag_s
            if abs(offset_s - self.offset_s) > FAST_CLOCK_S:
                self.since_s = now
            self.offset_s = offset_s
        elif self.offset_s and late_s < 0.0:
            self.offset_s = lag_s
        late_s = max(lag_s - self.offset_s, 0.0)
        self._was_quick = self._was_quick or late_s <= SLOW_CLOCK_S
        self._previous = lag_s, now
        unsure_s = 0.0 if not self.offset_s else UNKNOWN_S if bound_s is None else max(bound_s - late_s, 0.0)
        return StateTiming(time_s + self.offset_s, late_s, unsure_s)

    def _is_lag_from_clock(self, lag_s: float, late_s: float, bound_s: float | None, now: float) -> bool:
        """Whether the lag comes from the clock and not from the link."""
        if bound_s is not None:
            return late_s > bound_s + TOLERANCE_S
        if late_s > OLDEST_S:
            return True
        if self._previous is not None:
            previous_s, previous_at_s = self._previous
            if lag_s - previous_s > now - previous_at_s + TOLERANCE_S:
                return True
        return not self._was_quick and self._is_lag_constant(lag_s, now)

    def _is_lag_constant(self, lag_s: float, now: float) -> bool:
        """Whether the lag has been constant for SETTLED_S."""
        is_within = self._begun_s is not None and max(self._most_s, lag_s) - min(self._least_s, lag_s) <= SPREAD_S
        if not is_within or self._begun_s is None:
            self._begun_s, self._least_s, self._most_s = now, lag_s, lag_s
            return False
        self._least_s, self._most_s = min(self._least_s, lag_s), max(self._most_s, lag_s)
        return now - self._begun_s >= SETTLED_S


def format_utc(clock_s: float | None = None, precision: str = "milliseconds") -> str:
    """Seconds since 1970, or the present time, as in frames."""
    time_utc = datetime.now(UTC) if clock_s is None else datetime.fromtimestamp(clock_s, UTC)
    return time_utc.isoformat(timespec=precision).replace("+00:00", "Z")


def describe_offset(offset_s: float) -> str:
    """The error of a clock as text: 1:00:03 ahead."""
    text = str(timedelta(seconds=round(abs(offset_s)))).replace(",", "")
    return f"{text} {'behind' if offset_s > 0.0 else 'ahead'}"


class CommandFreshness:
    """The last sequence of the commands to each tractor since its lease was taken."""

    def __init__(self, latest_s: float) -> None:
        self.latest_s = latest_s  # age up to which a command is carried out
        self._last: dict[int, int] = {}

    def reset(self, tractor: int) -> None:
        """Start the sequences of a tractor again, at a new lease."""
        self._last.pop(tractor, None)

    def check_command_fresh(self, frame: CommandFrame, is_moving: bool, clock_s: float) -> None:
        """Raise FleetManagerError for a command that is too old or out of order; `clock_s` is since 1970.

        A command to stop (not `is_moving`) is never too old.
        """
        age_s = clock_s - frame.time.timestamp()
        last = self._last.get(frame.tractor, -1)
        if not is_moving:
            self._last[frame.tractor] = max(frame.sequence, last)
            return
        if frame.sequence <= last:
            raise FleetManagerError(
                f"Command {frame.sequence} came after command {last} and was ignored; give each "
                "command a higher sequence.",
                parameter="sequence",
            )
        if not -FUTURE_TOLERANCE_S <= age_s <= self.latest_s:
            raise FleetManagerError(
                f"The command is {age_s:.2f} s old and was ignored; it must be at most "
                f"{self.latest_s:g} s old by the clock of the service.",
                parameter="time",
            )
        self._last[frame.tractor] = frame.sequence


def check_order_fresh(frame: StartFrame | ResumeFrame | AcknowledgeFrame, clock_s: float) -> None:
    """Raise FleetManagerError for a late order to resume; `clock_s` is since 1970. An order without time passes."""
    age_s = 0.0 if frame.time is None else clock_s - frame.time.timestamp()
    if age_s > ORDER_AGE_S:
        raise FleetManagerError(
            f"The order to resume is {age_s:.1f} s old and was ignored; look at the tractors and send it again.",
            parameter="time",
        )
