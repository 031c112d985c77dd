"""Which effects the logs speak for: forward and backward selection with every other effect refitted, and challenges.

An effect enters when it takes more away than chance does: the threshold is the largest gain of any candidate over
what is left of these very data after the signs of its blocks of ten seconds were drawn at random. It must also help in
runs that had no part in the fit, and in most of the runs that it concerns. The base tractor is the file as given,
within the tolerance `finest` of each effect: an effect within its tolerance is a calibration without a name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from vehicle.effects import CATALOGUE, STEERING, effect
from vehicle.measured.causes.challenge import Alike, challenged
from vehicle.measured.causes.dependence import Dependence, Score, scores
from vehicle.measured.causes.evidence import helps, promised_costs
from vehicle.measured.causes.foreseen import Foresight, older
from vehicle.measured.causes.known import Known
from vehicle.measured.causes.patches import best_patch
from vehicle.measured.causes.refit import enlarged, restarted, retuned, with_part, with_unnamed, without
from vehicle.measured.causes.trial import Projector, Tried, gone_on, needed, strengths, tried
from vehicle.measured.fit.fitting import Fit, Part, refined
from vehicle.measured.fit.knobs import knobs_for
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import (
    ABOVE_CHANCE,
    CHANCE_SIGMAS,
    CLEARLY,
    FORESEEN,
    LEAST_GAIN,
    LEAST_STRENGTH,
    MATERIAL,
    MOST_CHANGES,
    MOST_PARTS,
    MOST_UNNAMED,
    PATCH_HANDICAP,
    PLAINLY,
)
from vehicle.tractor import Tractor

LEADING = 4  # chosen: the best of one scan are the best of the next, but for the one that entered
Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Selection:
    """What entered: the fit of effects and unnamed terms, those terms, what is as good by name and what was refused."""

    bench: Bench
    fit: Fit
    unnamed: tuple[Dependence, ...]
    threshold: float
    alike: Mapping[str, Alike] = field(default_factory=dict)
    refused: frozenset[str] = frozenset()

    @property
    def ids(self) -> frozenset[str]:
        """Effects in the fit."""
        return frozenset(self.fit.settings)


def scan(
    bench: Bench, fit: Fit, tractor: Tractor, skip: Collection[str], progress: Progress | None = None,
    known: Known | None = None, unnamed: bool = True,
) -> Known:  # fmt: skip
    """Every effect of the catalogue that is not in the fit, the best first; those that promise far less are only begun.

    What is foreseen to promise most, and the best of the scan before, are tried before others: an early best spares
    most of the time. What that scan tells as well of this fit is not tried again. Terms without a name are scored where
    one more may enter, being `unnamed`.
    """
    project = Projector(fit.slope)
    left = project(fit.surprise)
    still = known.still(bench, fit, left) if known else frozenset[str]()
    ahead, seen = Foresight(bench, fit, project, left), known.seen if known else {}
    first = {one.knobs.id: one.gain for one in known.candidates[:LEADING]} if known else {}
    candidates = list((known.found(still) if known else {}).values())
    candidates = [one for one in candidates if one.knobs.id not in skip and one.knobs.id not in fit.settings]
    told = {one.knobs.id for one in candidates} | set(skip) | set(fit.settings)
    asked = [one for one in CATALOGUE if one.id not in told]
    promises = ahead.promises(seen, [one.id for one in asked])
    first |= {name: one.whole for name, one in promises.items()}
    moved = older(seen)
    for entry in sorted(asked, key=lambda one: -first.get(one.id, 0.0)):
        knobs = knobs_for(tractor, entry.id, bench.course.places)
        if not bench.has_wheel:
            knobs = knobs.with_fewer_starts()
        if entry.kind.searched:
            patch = best_patch(bench, fit)
            if patch is None:
                continue
            knobs = knobs_for(tractor, entry.id, {entry.id: patch})
        worth = max((-_rank(one) for one in candidates), default=0.0)
        foreseen = ahead.hopeless(promises[entry.id], worth) if entry.id in promises else None
        if foreseen is None:
            foreseen = tried(bench.changes, fit, knobs, project, worth, left)
            if fit.parts:  # with one cause the second scan is the last, and nobody would ask
                moved |= ahead.motions(foreseen)
        candidates.append(foreseen)
        if progress:
            progress(entry.id)
    same = known is not None and known.same_path(bench, fit)
    ranked = () if not unnamed else known.scores if known and same else scores(bench, fit)
    return Known(fit, project, left, sorted(candidates, key=_rank), ranked, moved)


def ended(bench: Bench, known: Known, candidates: Sequence[Tried], than: Tried | None = None) -> list[Tried]:
    """Candidates of a scan with those that were only begun tried to their end, the best first.

    Not those that promise, or are foreseen to promise, far less than another one.
    """
    worth = 0.0 if than is None else max(-_rank(than), 0.0)

    def whole(one: Tried) -> Tried:
        if one.ended or (than and one.foreseen is not None and one.foreseen < FORESEEN * needed(worth)):
            return one
        return gone_on(bench.changes, known.fit, one, known.project, known.left, worth)

    return sorted(map(whole, candidates), key=_rank)


def _rank(one: Tried) -> float:
    """Order of the candidates: a circle that chose its own place must explain clearly more than a plain effect."""
    if effect(one.knobs.id).kind.searched:
        return -(one.gain / PATCH_HANDICAP - LEAST_GAIN)
    return -one.gain


def select(bench: Bench, tractor: Tractor, progress: Progress | None = None) -> Selection:
    """Forward and backward selection, then every cause challenged; where one gives way, all over from there."""
    chosen = Selection(bench, restarted(bench, (), None), (), LEAST_STRENGTH)
    refused: set[str] = set()
    for _ in range(MOST_CHANGES):
        chosen = _settled(_forward(chosen, tractor, refused, progress))
        outcome = challenged(chosen.bench, chosen.fit, chosen.unnamed, tractor)
        if outcome.better is None:
            return replace(chosen, alike=outcome.alike, refused=frozenset(refused))
        better = retuned(chosen.bench, outcome.better)
        fit = restarted(better, outcome.better.parts, outcome.unnamed)
        chosen = replace(chosen, bench=better, fit=fit, unnamed=outcome.unnamed)
    return replace(_settled(chosen), refused=frozenset(refused))


def _settled(chosen: Selection) -> Selection:
    """Without what has become superfluous."""
    bench, fit, unnamed = chosen.bench, pruned(chosen.bench, chosen.fit), chosen.unnamed
    for one in unnamed:
        others = tuple(other for other in unnamed if other is not one)
        smaller = with_unnamed(bench, fit, others)
        freedoms = fit.slope.shape[1] - smaller.slope.shape[1]
        if not _beyond_chance(bench, smaller.loss - fit.loss, freedoms, chosen.threshold):
            return _settled(replace(chosen, fit=smaller, unnamed=others))
    return replace(chosen, fit=fit)


def _forward(chosen: Selection, tractor: Tractor, refused: set[str], progress: Progress | None) -> Selection:
    """Forward selection from what was chosen; `refused` collects effects that helped no run held out."""
    bench, fit, unnamed, threshold = chosen.bench, chosen.fit, chosen.unnamed, chosen.threshold
    known: Known | None = None
    candidates: list[Tried] | None = None
    rival: Score | None = None
    while len(fit.parts) < MOST_PARTS:
        if known is None or candidates is None:
            known = scan(bench, fit, tractor, refused, progress, known, len(unnamed) < MOST_UNNAMED)
            candidates, rival = list(known.candidates), _rival(known.scores, unnamed)
        best, threshold = _clear(bench, known, candidates)
        # Where the best of all is not clear any other may be the one, unless an unnamed term goes before each of them.
        if candidates and best is not candidates[0] and not _before_all(bench, rival, unnamed, candidates, threshold):
            for than in (best, None) if best else (None,):  # nothing is left out as long as nothing is clear
                candidates = ended(bench, known, candidates, than)
                best, threshold = _clear(bench, known, candidates)
                if best is not None:
                    break
            known = replace(known, candidates=candidates)
        if rival and len(unnamed) < MOST_UNNAMED and _is_unnamed(bench, rival, best, threshold):
            unnamed, candidates = (*unnamed, rival.terms), None
            fit = with_unnamed(bench, fit, unnamed)
            continue
        if best is None:
            break
        larger = refined(bench, enlarged(bench, fit, best), 2)
        if not helps(bench, fit, larger, threshold):
            refused.add(best.knobs.id)
            candidates = ended(bench, known, [one for one in candidates if one.knobs.id != best.knobs.id])
            continue
        bench, candidates = retuned(bench, larger), None
        fit = restarted(bench, larger.parts, unnamed)
    return replace(chosen, bench=bench, fit=fit, unnamed=unnamed, threshold=threshold)


def _clear(bench: Bench, known: Known, candidates: list[Tried]) -> tuple[Tried | None, float]:
    """The best candidate that is clearly above chance, if any, and the strength that took."""
    strength, chance = strengths(bench, candidates, known.left)
    threshold = max(LEAST_STRENGTH, ABOVE_CHANCE * chance)
    told = (one for one, s in zip(candidates, strength, strict=True) if one.gain > LEAST_GAIN and s > threshold)
    return next(told, None), threshold


def _rival(ranked: Sequence[Score], unnamed: tuple[Dependence, ...]) -> Score | None:
    """The strongest unnamed term that is not in the fit; one period is as good as its neighbours."""
    taken = {(one.on if not one.per_run else "time", one.changes) for one in unnamed}
    for score in ranked:
        if (score.terms.on if not score.terms.per_run else "time", score.terms.changes) not in taken:
            return score
    return None


def _before_all(
    bench: Bench, rival: Score | None, unnamed: tuple[Dependence, ...], candidates: Sequence[Tried], threshold: float
) -> bool:
    """Whether an unnamed term enters whichever candidate is clear: those only begun promise less than the best."""
    most = max(candidates, key=lambda one: one.gain)
    return rival is not None and len(unnamed) < MOST_UNNAMED and _is_unnamed(bench, rival, most, threshold)


def _is_unnamed(bench: Bench, rival: Score, best: Tried | None, threshold: float) -> bool:
    """Whether an unnamed term explains clearly more than chance and than the best effect."""
    if not _beyond_chance(bench, rival.gain, rival.freedoms, threshold):
        return False
    return best is None or rival.gain - _by_chance(rival.freedoms) > CLEARLY * best.gain + LEAST_GAIN


def _beyond_chance(bench: Bench, gain: float, freedoms: int, threshold: float) -> bool:
    """Whether unnamed terms take away more than chance does, and more than simulators differ by."""
    return gain - _by_chance(freedoms) >= max(threshold, MATERIAL * 3.0 * bench.course.rows)


def _by_chance(freedoms: int) -> float:
    """Loss that as many free amounts take away by chance."""
    return freedoms + CHANCE_SIGMAS * math.sqrt(2.0 * freedoms)


def _doubtful(fit: Fit) -> list[Part]:
    """Parts that may be superfluous: those not plainly needed, and those of the steering, which straight lines belie.

    A wheel that is late by a dead time is so by a lag or a rate as well, at places far apart.
    """
    promised = promised_costs(fit)
    return [
        part for part in fit.parts
        if effect(part[0].id).block == STEERING or promised[part[0].id] < PLAINLY * LEAST_GAIN
    ]  # fmt: skip


def pruned(bench: Bench, fit: Fit) -> Fit:
    """Backward: leave out, one by one, what the others have made superfluous.

    A part whose place only let the others come closer to their best is put back beside them: it is superfluous when
    they still explain as much as with it.
    """
    put_back: set[str] = set()
    while fit.parts:
        doubtful = _doubtful(fit)
        if not doubtful:
            return fit
        smaller, part = min(
            ((without(bench, fit, part[0].id), part) for part in doubtful), key=lambda one: one[0].loss
        )
        if smaller.loss - fit.loss > LEAST_GAIN:
            return fit
        if part[0].id not in put_back:
            put_back.add(part[0].id)
            again = refined(bench, with_part(bench, smaller, part))
            smaller = again if smaller.loss - again.loss > LEAST_GAIN else smaller
        fit = smaller
    return fit
