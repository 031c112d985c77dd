"""Tracks grouped for a formation: runs of neighbouring tracks, rounds of them worked abreast, and what is left over.

A run follows the tracks from line to line where they overlap most, so that a hole or a notch parts runs and a few
short tracks beside them do not. In a run the quickest division into rounds is found by working backwards from its
end; tracks too short or too few for a round are worked by one tractor alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from fields.layout import Track
from strategies.formations.abreast import Slot, begins_at, missing_m, needed_m, slots_of
from strategies.job import Job, Pass

Corner = tuple[bool, int]
"""Begin at the last track? and the first direction."""
CORNERS: tuple[Corner, ...] = tuple((last, way) for last in (False, True) for way in (1, -1))
Run = list[Track]
Round = list[Slot]

Barred = frozenset[tuple[Pass, ...]]
"""Rounds that turned out to have no room, by their passes."""

ALIKE_RAD = 1e-6
NEXT = 1.5  # working widths within which a parallel track is the neighbour
FEWER = 3  # so many smaller rounds are tried where all tractors abreast have no room


@dataclass(frozen=True)
class Grouped:
    """A run in rounds of neighbouring tracks, in the order they are worked, and the tracks left over.

    `seconds` is an estimate of all of it.
    """

    seconds: float
    rounds: tuple[Round, ...]
    alone: tuple[Track, ...]


@dataclass(frozen=True)
class Grouping:
    """All rounds in order, for each whether the tractors come to it from afar, and the tracks left over."""

    seconds: float
    rounds: list[Round]
    moved: list[bool]
    alone: list[Track]


def runs_of(job: Job) -> list[Run]:
    """Neighbouring tracks long enough for a formation, each joined to the one on the next line it overlaps most."""
    least = needed_m(job, min(job.tractors, 2))
    tracks = [track for track in job.layout.tracks if track.length >= least]
    pairs = sorted(_overlaps(job, tracks), key=lambda pair: (-pair[0], pair[1], pair[2]))
    after: dict[int, int] = {}
    taken: set[int] = set()
    for _, a, b in pairs:
        if a not in after and b not in taken:
            after[a] = b
            taken.add(b)
    runs = []
    for index in range(len(tracks)):
        if index not in taken:
            run = [index]
            while run[-1] in after:
                run.append(after[run[-1]])
            runs.append([tracks[one] for one in run])
    return runs


def _overlaps(job: Job, tracks: list[Track]) -> Iterator[tuple[float, int, int]]:
    """Pairs of neighbouring parallel tracks: by how many metres they overlap, and their places in the list."""
    by_line: dict[int, list[int]] = {}
    for index, track in enumerate(tracks):
        by_line.setdefault(track.line, []).append(index)
    for a, track in enumerate(tracks):
        for b in by_line.get(track.line + 1, []):
            overlap = _overlap_m(job, Pass(track, 1), Pass(tracks[b], 1))
            if overlap > 0.0:
                yield round(overlap, 3), a, b


def _overlap_m(job: Job, a: Pass, b: Pass) -> float:
    """How far two passes lie side by side (m); 0 or less where they do not."""
    (ax, ay, heading), (bx, by, other) = job.entry(a), job.entry(b)
    across = abs((by - ay) * math.cos(heading) - (bx - ax) * math.sin(heading))
    if abs(math.remainder(other - heading, 2.0 * math.pi)) > ALIKE_RAD or across > NEXT * job.layout.width_m:
        return 0.0
    first, second = begins_at(job, a), begins_at(job, b)
    return min(first + a.track.length, second + b.track.length) - max(first, second)


def grouped(job: Job, run: Run, from_last: bool, barred: Barred = frozenset()) -> dict[Corner, Grouped]:
    """The quickest divisions of a run into rounds other than those barred, from the two corners at one of its sides."""
    tracks = run[::-1] if from_last else run
    best: dict[tuple[int, int], tuple[float, Round | None]] = {(len(tracks), way): (0.0, None) for way in (1, -1)}
    for first in range(len(tracks) - 1, -1, -1):
        for way in (1, -1):
            options: list[tuple[float, Round | None]] = [
                (alone_s(job, tracks[first]) + best[first + 1, way][0], None)
            ]
            for slots in _rounds_at(job, tracks, first, way, barred):
                rest = first + len(slots)
                back_s = _rejoin_s(job, slots) if rest < len(tracks) else 0.0
                options.append((round_s(job, slots) + back_s + best[rest, -way][0], slots))
            best[first, way] = min(options, key=lambda option: (round(option[0], 3), -len(option[1] or ())))
    return {(from_last, way): _picked(tracks, best, way) for way in (1, -1)}


def _picked(tracks: list[Track], best: dict[tuple[int, int], tuple[float, Round | None]], direction: int) -> Grouped:
    """The division of which `best` knows, by track and direction, the seconds of the rest and the round it begins."""
    rounds, alone, first, way = list[Round](), list[Track](), 0, direction
    while first < len(tracks):
        chosen = best[first, way][1]
        if chosen is None:
            alone.append(tracks[first])
            first += 1
        else:
            rounds.append(chosen)
            first, way = first + len(chosen), -way
    return Grouped(best[0, direction][0], tuple(rounds), tuple(alone))


def _rounds_at(job: Job, tracks: list[Track], first: int, way: int, barred: Barred) -> Iterator[Round]:
    """The largest round that has room on the tracks from one on; of one track alone only at the end of the run."""
    left = len(tracks) - first
    for count in range(min(job.tractors, left), max(min(job.tractors, left) - FEWER, 0) - 1, -1):
        if count == 0 or (count == 1 < job.tractors and left > 1):
            return
        slots = slots_of(job, [Pass(track, way) for track in tracks[first : first + count]])
        if missing_m(slots) <= 0.0 and key_of(slots) not in barred:
            yield slots
            return


def key_of(slots: Sequence[Slot]) -> tuple[Pass, ...]:
    """The passes of a round, by which it is barred."""
    return tuple(slot.this for slot in slots)


def round_s(job: Job, slots: Round) -> float:
    """Estimated seconds of a round, from the first end of a track to the last, and of the turns into it."""
    begins = [begins_at(job, slot.this) for slot in slots]
    ends = [begin + slot.this.track.length for begin, slot in zip(begins, slots, strict=True)]
    rows, table = max(slot.row for slot in slots), job.manner.turn_s
    return (max(ends) - min(begins)) / job.manner.work_speed_mps + rows * table[min(len(slots), len(table) - 1)]


def alone_s(job: Job, track: Track) -> float:
    """Estimated seconds of a track that one tractor works alone, with the turn to it."""
    return track.length / job.manner.work_speed_mps + job.manner.turn_s[1]


def _rejoin_s(job: Job, slots: Round) -> float:
    """Estimated seconds for tractors that had no track in a round to come round to its other end."""
    if len(slots) == job.tractors:
        return 0.0
    return max(slot.this.track.length for slot in slots) / job.manner.turn_speed_mps


@dataclass(frozen=True)
class Divided:
    """All runs of a job, and how each is divided from each of its corners."""

    runs: list[Run]
    known: dict[tuple[int, Corner], Grouped]


def divided(job: Job, barred: Barred = frozenset()) -> Divided:
    """The runs of a job divided, whatever corner of the field it begins at; worked out once for all jobs of a site."""
    key = "divided", job.tractors, job.layout.tracks, barred
    if key not in job.formations:
        runs, known = runs_of(job), dict[tuple[int, Corner], Grouped]()
        for index, run in enumerate(runs):
            for from_last in (False, True):
                known.update({(index, each): one for each, one in grouped(job, run, from_last, barred).items()})
        job.formations[key] = Divided(runs, known)
    return job.formations[key]  # type: ignore[no-any-return]


def grouping(job: Job, parts: Divided) -> Grouping:
    """All tracks of a job in rounds, run after run from its corner on, always to the run that is reached soonest.

    The run to begin with is the one from which all takes least, the ways from a gate and back to it included; where
    there is no gate, but an entrance, it is the one nearest to that.
    """
    corner, runs, known = job.corner or (False, 1), parts.runs, parts.known
    some = [index for index in range(len(runs)) if any(_abreast(job, known[index, each]) for each in CORNERS)]
    used = {track for index in some for track in runs[index]}
    left = [track for track in job.layout.tracks if track not in used]
    entrance = job.layout.field.entrance
    starts = [index for index in some if _abreast(job, known[index, corner])]
    if entrance is not None and job.gate is None and starts:
        starts = [min(starts, key=lambda index: _away_m(job, known[index, corner], entrance))]
    tours = [_tour(job, known, some, start, corner, left) for start in starts]
    nothing = Grouping(0.0, [], [], list(job.layout.tracks))
    return min(tours, key=lambda tour: round(tour.seconds, 3), default=nothing)


def _abreast(job: Job, group: Grouped) -> bool:
    """Whether a run has a round worth forming for."""
    return any(len(slots) >= min(job.tractors, 2) for slots in group.rounds)


def _away_m(job: Job, group: Grouped, place: tuple[float, float]) -> float:
    """How far a run begins from a place."""
    return min(round(math.dist(place, job.entry(slot.this)[:2]), 3) for slot in group.rounds[0])


def _tour(
    job: Job, known: dict[tuple[int, Corner], Grouped], some: list[int], start: int, corner: Corner, left: list[Track]
) -> Grouping:
    """All runs with rounds, beginning with one of them at its corner."""
    groups, seconds, rest = [known[start, corner]], 0.0, [index for index in some if index != start]
    while rest:
        options = [
            (round(_between_s(job, groups[-1].rounds[-1], known[index, each].rounds[0]), 3), place, index, each)
            for index in rest
            for place, each in enumerate(CORNERS)
            if _abreast(job, known[index, each])
        ]
        way_s, _, index, each = min(options)
        groups[-1] = _without_singles(job, groups[-1])
        groups.append(known[index, each])
        rest.remove(index)
        seconds += way_s
    rounds = [slots for group in groups for slots in group.rounds]
    firsts = [number == 0 for group in groups for number in range(len(group.rounds))]
    present = [{slot.tractor for slot in slots} for slots in rounds]
    moved = [
        number > 0 and (firsts[number] or not present[number] <= present[number - 1]) for number in range(len(rounds))
    ]
    alone = [track for group in groups for track in group.alone] + left
    seconds += sum(group.seconds for group in groups) + sum(alone_s(job, track) for track in left)
    seconds += job.gate_time(rounds[0][0].this, rounds[-1][-1].this)
    return Grouping(seconds, rounds, moved, alone)


def _without_singles(job: Job, group: Grouped) -> Grouped:
    """A run after which others follow: a track left over at its end does not hold up the formation."""
    last = group.rounds[-1]
    if len(last) > 1 or job.tractors == 1:
        return group
    return replace(group, rounds=group.rounds[:-1], alone=(*group.alone, last[0].this.track))


def _between_s(job: Job, before: Round, after: Round) -> float:
    """Estimated seconds until a formation has moved on to another run."""
    a, b = ({slot.row: slot.this for slot in slots}[1] for slots in (before, after))
    return max(slot.row for slot in after) * job.turn_time(a, b)
