"""The last check of a verdict: no effect is told whose interval holds neutral, or whose size is within the tolerance of
the tractor file, whatever stage added it; and none is named that may be hardly there."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace

from vehicle.identification.cause_selection.merging import COMMAND_CLOCK, DEAD_TIME
from vehicle.identification.cause_selection.selection import CauseSelection
from vehicle.identification.diagnosis.results import CONSTANT_LAW, EQUIVALENT, LIKELY, NAMED, NOT_VISIBLE, Finding
from vehicle.identification.fit.effect_parameters import find_finest_size
from vehicle.identification.residuals.residual_model import RECEIVER_DELAY
from vehicle.identification.thresholds import (
    MOST_USUAL_DIFFERENCES,
    NEAR_NEUTRAL_SHARE,
    SENSOR_TIMING_S,
    WIDEST_NAMED_SPAN,
)
from vehicle.identification.verdict.held_out_case import DiagnosisCase, is_within_noise
from vehicle.identification.verdict.named_causes import ExplainedCase, keep_terms
from vehicle.model.discrepancy_model import TERMS_BY_NAME
from vehicle.model.effect_kinds import PER_SLOPE
from vehicle.model.effects import get_effect, get_neutral_values
from vehicle.model.tractor import SteeringParameters, Tractor

GAIN, ANTENNA = "steering_gain", "antenna_forward"
SPEED_CLOCK, POSITION_DELAY = "clock_offset_speed", "position_delay"
RATE, LAG = "steering_rate", "steering_lag"
HEADING_FILTER, HEADING_CLOCK = "heading_filter", "clock_offset_heading"


def drop_unclear_terms(
    selection: CauseSelection, explained_case: ExplainedCase, changing_ids: Collection[str]
) -> ExplainedCase:
    """Return the case without effects that may be neutral; `changing_ids` follow a law, whose mean may be neutral."""
    case = explained_case.case
    unclear_ids = {
        name
        for name in case.extension.term_ids
        if name not in TERMS_BY_NAME and name not in changing_ids and _is_unclear_term(case, name)
    }
    if not unclear_ids:
        return explained_case
    return keep_terms(selection, explained_case, case.extension.term_ids - unclear_ids)


def _is_unclear_term(case: DiagnosisCase, name: str) -> bool:
    """Whether a term may be neutral. Of two levels, one may be: that of the ground which the file describes."""
    if _has_levels(case, name):
        return False
    intervals, term = case.extension.intervals[name], case.main_terms[name]
    if PER_SLOPE in intervals:
        return intervals[PER_SLOPE][0] <= 0.0 <= intervals[PER_SLOPE][1]
    finest = find_finest_size(case.tractor, name, case.residual_model.get_interval_s(name))
    return (
        _holds_neutral(case, name, intervals[get_effect(name).size.name])
        or term.parameters.compute_deviation(term.coordinates) <= finest
    )


def _holds_neutral(case: DiagnosisCase, name: str, interval: tuple[float, float]) -> bool:
    return interval[0] <= get_neutral_values(name, case.tractor.steering)[get_effect(name).size.name] <= interval[1]


def withdraw_unclear(findings: Sequence[Finding], case: DiagnosisCase) -> list[Finding]:
    """Return the findings without a name, or a likely effect, that may be neutral; a name that may be hardly there is
    likely."""
    kept = [_withdraw(finding) if _is_unclear(finding, case) else finding for finding in findings]
    return [replace(finding, status=LIKELY) if _is_hardly_there(finding, case) else finding for finding in kept]


def withdraw_faked(findings: Sequence[Finding], faked_ids: AbstractSet[str]) -> list[Finding]:
    """Return the findings without what stands in for another cause; an effect that is equally likely goes with it."""
    return [
        _withdraw(finding)
        if finding.status in (NAMED, LIKELY, EQUIVALENT)
        and not faked_ids.isdisjoint({finding.id, *finding.equivalent_to})
        else finding
        for finding in findings
    ]


def doubt_names(findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings without names, which are likely: the tractor file is of another kind of vehicle.

    The rams of a joint move half of the vehicle, so neither its delay nor its rate is one of steered wheels.
    """
    return [replace(finding, status=LIKELY) if finding.status == NAMED else finding for finding in findings]


def doubt_stand_ins(findings: Sequence[Finding], tractor: Tractor, has_unnamed: bool) -> list[Finding]:
    """Return the findings with effects that are only likely, as another one beside them may be all there is.

    `has_unnamed` is whether something without a name is left.
    """
    findings = doubt_filtered_positions(doubt_turning_centre(findings, tractor.wheelbase_m), has_unnamed)
    return doubt_follow_stage(findings, tractor.steering)


def doubt_follow_stage(findings: Sequence[Finding], steering: SteeringParameters) -> list[Finding]:
    """Return the findings with a lag or dead time that is only likely, as a file has one gap from which it slews.

    A steering slews where its gap is more than its rate times its lag. With another rate or lag that gap is another
    one: a slower rate also limits smaller gaps, which looks like a lag up to the gap over the rate; and a longer lag
    begins at larger gaps, which looks like a dead time of up to as much as it is longer than the gap over the rate.
    """
    found = {finding.id: finding for finding in findings if finding.status in (NAMED, LIKELY) and finding.value}
    rate, lag, dead = (found.get(name) for name in (RATE, LAG, DEAD_TIME))
    doubtful = set()
    if rate is not None and lag is not None:
        limit_s = steering.switch_deg / _get_size(rate)
        doubtful |= {LAG} if steering.lag_s < _get_size(lag) <= limit_s else set()
    if lag is not None and dead is not None:
        longer_s = _get_size(lag) - steering.switch_deg / steering.rate_deg_per_s
        doubtful |= {DEAD_TIME} if 0.0 < _get_size(dead) <= longer_s else set()
    return [
        replace(finding, status=LIKELY) if finding.id in doubtful and finding.status == NAMED else finding
        for finding in findings
    ]


def _get_size(finding: Finding) -> float:
    assert finding.value is not None
    return finding.value[get_effect(finding.id).size.name]


def doubt_turning_centre(findings: Sequence[Finding], wheelbase_m: float) -> list[Finding]:
    """Return the findings with an antenna that is only likely where rear wheels that steer too would look the same.

    With rear wheels at a share s of the angle of the front wheels, to the other side, the vehicle turns by 1 + s more,
    about a point s / (1 + s) of the wheelbase ahead of the rear axle: a gain g, and an antenna that seems further back
    by (1 - 1 / g) of the wheelbase. To the same side s is negative. The gain itself is what both have.

    A rear axle that resists turning, as with a locked differential, moves that point by less: a gain that has no name
    leaves none to the antenna either.
    """
    found = {finding.id: finding for finding in findings if finding.status in (NAMED, LIKELY)}
    gain, antenna = found.get(GAIN), found.get(ANTENNA)
    if gain is None or antenna is None or not (gain.interval and antenna.interval):
        return list(findings)
    least, most = (-(1.0 - 1.0 / ratio) * wheelbase_m for ratio in reversed(gain.interval["ratio"]))
    low, high = antenna.interval["distance_m"]
    if gain.status == LIKELY:
        least, most = min(least, 0.0), max(most, 0.0)
    if antenna.status != NAMED or high < least or low > most:
        return list(findings)
    words = "together with this steering_gain, rear wheels that steer with the front wheels would look the same"
    doubtful = replace(antenna.add_exchange(words), status=LIKELY)
    return [doubtful if finding is antenna else finding for finding in findings]


def doubt_shared_lateness(findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings without a clock of the speed that is that of the receiver.

    Only differences between clocks show. Positions, headings and speeds that are as late as each other are late beside
    the wheel angles alone, as they are in any vehicle that turns later than its wheels: without a name up to
    MOST_USUAL_DIFFERENCES of SENSOR_TIMING_S.
    """
    found = {finding.id: finding for finding in findings if finding.status in (NAMED, LIKELY)}
    late, clock = found.get(RECEIVER_DELAY), found.get(SPEED_CLOCK)
    if late is None or clock is None or not (late.interval and clock.interval and late.value):
        return list(findings)
    ends, other_ends = late.interval["time_s"], clock.interval["time_s"]
    if max(ends[0], other_ends[0]) > min(ends[1], other_ends[1]):
        return list(findings)
    is_usual = late.value["time_s"] <= MOST_USUAL_DIFFERENCES * SENSOR_TIMING_S
    doubtful = replace(late, status=LIKELY) if is_usual else late
    kept = {RECEIVER_DELAY: doubtful, SPEED_CLOCK: _withdraw(clock)}
    return [kept.get(finding.id, finding) for finding in findings]


def doubt_filtered_positions(findings: Sequence[Finding], has_unnamed: bool) -> list[Finding]:
    """Return the findings with an antenna that is only likely where it takes back a part of late positions.

    Positions that pass a filter are late by another time in every manoeuvre: a delay that suits the longest of them
    and an antenna further ahead suit all of them halfway, and leave something without a name (`has_unnamed`).
    """
    found = {finding.id: finding for finding in findings if finding.status in (NAMED, LIKELY)}
    delay, antenna = found.get(POSITION_DELAY), found.get(ANTENNA)
    if not has_unnamed or delay is None or antenna is None or antenna.status != NAMED or antenna.value is None:
        return list(findings)
    if antenna.value["distance_m"] <= 0.0:
        return list(findings)
    words = "together with these late positions, a filter of the positions would look the same"
    doubtful = replace(antenna.add_exchange(words), status=LIKELY)
    return [doubtful if finding is antenna else finding for finding in findings]


def withdraw_cancelling_delays(findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings without two delays of one column that cancel each other.

    A dead time of the steering and a clock of its commands leave wheels that follow the commands of the log without
    delay; a smoothed heading that is stamped too early by as much is not late. Both stand in for a column that is wrong
    in another way, such as a wheel sensor with play, or an antenna that sways.
    """
    found = {finding.id: finding for finding in findings if finding.status in (NAMED, LIKELY)}
    withdrawn = [
        finding
        for name, other, sign in ((DEAD_TIME, COMMAND_CLOCK, 1.0), (HEADING_FILTER, HEADING_CLOCK, -1.0))
        if name in found and other in found and _cancel_each_other(found[name], found[other], sign)
        for finding in (found[name], found[other])
    ]
    return [_withdraw(finding) if finding in withdrawn else finding for finding in findings]


def _cancel_each_other(delay: Finding, clock: Finding, sign: float) -> bool:
    """Whether a delay (s) is `sign` times that of a clock, within the intervals of both."""
    if not (delay.interval and clock.interval and delay.value and clock.value):
        return False
    left_s = abs(delay.value["time_s"] - sign * clock.value["time_s"])
    halves = (0.5 * (one.interval["time_s"][1] - one.interval["time_s"][0]) for one in (delay, clock) if one.interval)
    return left_s <= math.hypot(*halves)


def _is_unclear(finding: Finding, case: DiagnosisCase) -> bool:
    """Whether a named or likely effect may be neutral.

    The mean of a law may be. Without a value of its own it is only told where an error remains that it may explain.
    """
    if finding.status not in (NAMED, LIKELY) or finding.value is None or finding.interval is None:
        return False
    if _is_changing(finding):
        return finding.id not in case.extension.term_ids and is_within_noise(case, case.final_errors)
    if finding.id in case.extension.term_ids:
        return _is_unclear_term(case, finding.id)
    size = get_effect(finding.id).size.name
    finest = find_finest_size(case.tractor, finding.id, case.residual_model.get_interval_s(finding.id))
    deviation = abs(finding.value[size] - get_neutral_values(finding.id, case.tractor.steering)[size])
    return deviation <= finest or _holds_neutral(case, finding.id, finding.interval[size])


def _is_hardly_there(finding: Finding, case: DiagnosisCase) -> bool:
    """Whether a name may be so small that it means nothing, or is known to hardly more than its order of magnitude.

    The interval of a limit is compared by what the limit takes away, that of two levels is of one of them.
    """
    if finding.status != NAMED or finding.interval is None or _is_changing(finding) or _has_levels(case, finding.id):
        return False
    if get_effect(finding.id).kind.is_searched and finding.gain_interval is not None and finding.gain_interval[0] <= 0:
        return True  # a circle somewhere in the field that helps hardly more runs than it harms
    size = get_effect(finding.id).size.name
    key = PER_SLOPE if PER_SLOPE in finding.interval else size
    neutral = 0.0 if key == PER_SLOPE else get_neutral_values(finding.id, case.tractor.steering)[size]
    ends = finding.interval[key]
    if math.isinf(neutral):
        near, far = (1.0 / end for end in reversed(ends))
    else:
        near, far = sorted(abs(end - neutral) for end in ends)
    finest = 0.0
    if key == size:
        finest = find_finest_size(case.tractor, finding.id, case.residual_model.get_interval_s(finding.id))
    return near < NEAR_NEUTRAL_SHARE * finest or far > WIDEST_NAMED_SPAN * near


def _is_changing(finding: Finding) -> bool:
    return finding.law is not None and finding.law.kind != CONSTANT_LAW


def _has_levels(case: DiagnosisCase, name: str) -> bool:
    return sum(term.parameters.id == name for term in case.extension.terms) > 1


def _withdraw(finding: Finding) -> Finding:
    empty = replace(finding, status=NOT_VISIBLE, value=None, interval=None, gain_pct=None, gain_interval=None)
    return replace(empty, description="", law=None, equivalent_to=(), exchange="")
