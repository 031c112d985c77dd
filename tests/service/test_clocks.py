"""Clocks of tractors that are wrong, and links that are slow: what tells one from the other."""

import json
import time
from datetime import UTC, datetime

import numpy as np
import pytest

from planner.fleet.model.rules import FleetManagerError, FleetRules
from planner.fleet.session import fleet_session as lives
from planner.fleet.session.clients import TRACTOR, FleetClient
from planner.fleet.session.fleet_session import FleetSession
from planner.fleet.session.frame_timing import (
    SETTLED_S,
    SLOW_CLOCK_S,
    UNKNOWN_S,
    StateTiming,
    TractorClock,
    describe_offset,
)
from planner.fleet.session.inbound_frames import StateFrame
from tests.service.fleets import fleet_plan, state

NOW = 1.9e9  # of the service, when its clock of beats shows 0


class Link:
    """A tractor whose clock is `ahead_s` and the states of which come ten times a second."""

    def __init__(self, ahead_s: float = 0.0, *, echoes: bool) -> None:
        self.clock, self.ahead_s, self.echoes, self.now = TractorClock(), ahead_s, echoes, 0.0
        self.clock.note_new_link()

    def come(self, delay_s: float, after_s: float = 0.1) -> StateTiming:
        """The next state comes so late; where it echoes, the beat that it had heard was as long on its way."""
        self.now += after_s
        made_s = self.now - delay_s
        beat_s = max(made_s - delay_s, 0.0) if self.echoes else None
        return self.clock.date_state(NOW + made_s + self.ahead_s, NOW + self.now, self.now, beat_s)

    def true_s(self, delay_s: float) -> float:
        """When the state that came now was made, by the clock of the service."""
        return NOW + self.now - delay_s


@pytest.mark.parametrize("echoes", [True, False])
@pytest.mark.parametrize("ahead_s", [3603.0, -3603.0, 2.5, 1e9, -1e9])
def test_a_clock_that_is_off_from_the_first_state_on_is_corrected_to_the_quickest_of_them(
    ahead_s: float, echoes: bool
) -> None:
    link, random = Link(ahead_s, echoes=echoes), np.random.default_rng(1)
    for delay_s in 0.05 + 0.2 * random.random(100):
        reading = link.come(float(delay_s))
        assert abs(reading.time_s - link.true_s(float(delay_s))) <= 0.3
    assert link.clock.offset_s == pytest.approx(-ahead_s + 0.05, abs=0.02)
    assert reading.age_s <= 0.25 and (reading.unsure_s == UNKNOWN_S) == (not echoes)


@pytest.mark.parametrize("ahead_s", [0.0, 1.5, -3.0])
def test_a_clock_that_is_right_enough_is_left_alone(ahead_s: float) -> None:
    link = Link(ahead_s, echoes=False)
    for delay_s in (0.1, 0.5, 1.0, 0.1):
        reading = link.come(delay_s)
        assert reading.time_s == pytest.approx(link.true_s(delay_s) + ahead_s) and reading.unsure_s == 0.0
    assert link.clock.offset_s == 0.0


@pytest.mark.parametrize("echoes", [True, False])
@pytest.mark.parametrize("ahead_s", [0.0, 3603.0])
def test_a_lag_that_grows_is_a_slow_link_and_stays_one(ahead_s: float, echoes: bool) -> None:
    link = Link(ahead_s, echoes=echoes)
    for _ in range(20):
        link.come(0.1)
    for delay_s in np.arange(0.1, 30.0, 0.05):
        reading = link.come(float(delay_s))
        assert reading.age_s == pytest.approx(delay_s, abs=0.2)
    for _ in range(200):  # for longer than what is constant from the beginning is taken for a clock
        reading = link.come(30.0)
    assert reading.age_s == pytest.approx(30.0, abs=0.2) and link.clock.offset_s == pytest.approx(-ahead_s, abs=0.2)


@pytest.mark.parametrize("echoes", [True, False])
def test_states_that_waited_for_a_link_come_late_and_their_clock_is_right(echoes: bool) -> None:
    link = Link(echoes=echoes)
    link.now = 100.0
    for delay_s in np.arange(60.0, 0.1, -0.1):  # a minute of states within a second
        reading = link.come(float(delay_s), after_s=0.001)
        assert reading.age_s == pytest.approx(delay_s)
    assert link.clock.offset_s == 0.0 and link.come(0.1).unsure_s == 0.0


def test_a_constant_lag_is_a_link_for_who_echoes_and_is_taken_for_a_clock_for_who_does_not() -> None:
    echoing, mute = Link(echoes=True), Link(echoes=False)
    for link in (echoing, mute):
        link.now = 100.0
    for step in range(round(10 * SETTLED_S) + 5):
        assert echoing.come(10.0).age_s == pytest.approx(10.0)
        reading = mute.come(10.0)
        assert reading.age_s > SLOW_CLOCK_S or step * 0.1 > SETTLED_S - 0.15
    assert echoing.clock.offset_s == 0.0
    assert mute.clock.offset_s == pytest.approx(10.0) and reading.unsure_s == UNKNOWN_S


@pytest.mark.parametrize("by_s", [3600.0, -3600.0, 30.0, -30.0])
def test_a_clock_that_is_set_while_it_drives_is_seen_at_once_and_when_it_is_right_again(by_s: float) -> None:
    link = Link(echoes=False)
    for ahead_s in (0.0, by_s, 0.0):
        link.ahead_s = ahead_s
        for _ in range(10):
            reading = link.come(0.1)
            assert reading.age_s <= 0.2 and reading.time_s == pytest.approx(link.true_s(0.1), abs=0.2)
    assert link.clock.offset_s == 0.0


def test_a_link_that_stood_still_is_no_clock_that_was_set_and_a_slow_one_with_a_wrong_clock_shows_its_age() -> None:
    link = Link(echoes=False)
    link.come(0.1)
    assert link.come(29.0, after_s=30.0).age_s == pytest.approx(29.0)  # held up, and the next come all at once
    assert link.come(28.9, after_s=0.0).age_s == pytest.approx(28.9)
    link = Link(3603.0, echoes=True)
    for _ in range(100):
        reading = link.come(1.5)
    assert reading.age_s + reading.unsure_s >= 1.5, "what a right clock would show, or more"
    assert describe_offset(-3603.2) == "1:00:03 ahead" and describe_offset(62.0) == "0:01:02 behind"
    assert describe_offset(-86_400.0) == "1 day 0:00:00 ahead" and describe_offset(200_000.0) == "2 days 7:33:20 behind"


@pytest.mark.slow
@pytest.mark.parametrize("echoes", [True, False])
def test_a_tractor_whose_clock_is_an_hour_off_drives_on_and_that_is_told_once(
    echoes: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lives, "CLOCK_ALARM_S", 0.2)
    begin_s = time.time()
    fleet = FleetSession("f", "small", fleet_plan(), FleetRules(), begin_s=begin_s)
    tractor = FleetClient(TRACTOR, "tractor 1", 0)
    fleet.add_client(tractor, time.monotonic())
    fleet.manager.operators.start_fleet_work("anna", 0.0)

    def say(sequence: int, **other: object) -> None:
        at = datetime.fromtimestamp(time.time() + 3603.0, UTC).isoformat()
        echo = {"heartbeat_s": time.monotonic() - 0.1} if echoes else {}
        frame = state(sequence, time=at, mode="remote", northing_m=2010.0) | echo | other
        fleet.take_state(tractor, StateFrame.model_validate_json(json.dumps(frame)), time.monotonic())

    for sequence in range(30):
        say(sequence)
        time.sleep(0.02)
    rows = fleet.recorder.waiting[0]
    assert len(rows) == 30 and all(-0.5 < row[1] < time.time() - begin_s + 0.5 for row in rows)
    (alarm,) = fleet.manager.alarms.list_alarms()
    assert alarm.sentence.startswith("The clock of tractor 1 is 1:00:03 ahead; its times are corrected to the clock of")
    fleet.manager.obstacle_reports.acknowledge_alarm("anna", alarm.id, 0.0)
    for sequence in range(30, 40):
        say(sequence)
    assert [each.acknowledged for each in fleet.manager.alarms.list_alarms()] == ["anna"], "it is told once"
    now = time.monotonic()
    fleet.manager.operators.take_lease("anna", 0, False, now)
    if echoes:
        fleet.manager.operators.send_command("anna", 0, 0.0, 0.5, now)
        return
    assert "Set it before you drive by remote control" in alarm.sentence
    with pytest.raises(FleetManagerError, match="its present place is unknown"):
        fleet.manager.operators.send_command("anna", 0, 0.0, 0.5, now)
