"""Results in plain words: durations, counts, the headline of a ranking and why plans were refused."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

from reports.effect_words import both, value_words
from reports.results import MissedPiece, PlanResult, Ranking, done_s, finish_cost, finish_s, finished_done_s

NOTHING = "-"
SOFT_HYPHEN = "\N{SOFT HYPHEN}"
DAY_S = 86_400
SAME_S = 0.5  # times so near each other are told as one
NO_BREAK = "\N{NO-BREAK SPACE}"
LEFT_WORDS = "Left is ground that no implement worked; ranks count the time to finish it too, at each plan's own rate."
COLUMN_WORDS = {
    "Turning": "of all tractors together",
    "Waiting": "likewise",
    "Worked %": "of the field",
    "Overlap %": "of the field, worked more than once",
    "Clearance m": "the nearest that two tractors come, implements included",
    "In time %": "of the draws, from and to (95 % sure) where they are few",
    "Paid": "in the mean of the draws",
    "Expected": "likewise, with what ground loses that is late",
}
"""What columns of plans hold, where their headings do not say it."""
WIDE = 0.015  # of a probability to either side: whole percents would say more than the draws do
LEAST_MONEY = 0.005  # less reads as nothing
BY_COUNT_WORDS = (
    "Half the time, At 95 %: field work takes no longer in half and in 95 % of the draws, with a late start, stops "
    "and breakdowns."
)
LEAST_GAP_PCT = 0.05  # less reads as nothing
LEAST_LEFT_M2 = 0.5  # less reads as nothing
LEAST_ON_MAP_M2 = 10.0  # words on a map would hide more than a smaller piece
_NUMBER = re.compile(r"\d+(?:\.\d+)?")


@dataclass(frozen=True)
class Refusal:
    """Plans that were refused for the same reason, figures apart.

    `reason` is the reason of the first one, `plans` all of them, `alike` whether the figures differ among them.
    """

    reason: str
    plans: tuple[PlanResult, ...]
    alike: bool


def duration(seconds: float | None) -> str:
    """Seconds as ``h:mm:ss`` to the nearest second, short ones too: 48:53 could be hours; a dash when there is none."""
    if seconds is None or not math.isfinite(seconds):
        return NOTHING
    hours, rest = divmod(_whole(abs(seconds)), 3600)
    minutes, secs = divmod(rest, 60)
    sign = "-" if seconds <= -0.5 else ""
    return f"{sign}{hours}:{minutes:02d}:{secs:02d}"


def minutes(seconds: float | None) -> str:
    """Seconds as the thesis prints them, ``74:35``: minutes without hours; a dash when there is none."""
    if seconds is None or not math.isfinite(seconds):
        return NOTHING
    whole = _whole(abs(seconds))
    return ("-" if seconds <= -0.5 else "") + f"{whole // 60}:{whole % 60:02d}"


def _whole(seconds: float) -> int:
    return math.floor(seconds + 0.5)


def number(value: float | None, decimals: int) -> str:
    """A figure with fixed decimals and no negative zero; a dash when it is missing or not finite."""
    if value is None or not math.isfinite(value):
        return NOTHING
    text = f"{value:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0 else text


def price(value: float | None) -> str:
    """A cost with as many decimals as keep it short: two, or none from 1000 on."""
    return number(value, 2 if value is None or abs(value) < 999.995 else 0)


def percent(share: float | None) -> str:
    """A probability in percent; a dash when there is none. What is not certain is not rounded to it."""
    if share is not None and 0.995 <= share < 1.0:
        return ">99"
    if share is not None and 0.0 < share < 0.005:
        return "<1"
    return number(None if share is None else 100.0 * share, 0)


def is_wide(interval: tuple[float, float] | None) -> bool:
    """Whether draws are too few for a probability in whole percent."""
    return interval is not None and interval[1] - interval[0] > 2.0 * WIDE


def in_time(plan: PlanResult) -> str:
    """How sure a plan is in percent, from and to where draws are few; a dash when it is not known."""
    interval = plan.finish_probability_interval
    if interval is None or not is_wide(interval):
        return percent(plan.finish_probability)
    low, high = (f"{100.0 * end:.0f}" for end in interval)
    return f"{low}-{high}"


def late_counts(ranking: Ranking) -> bool:
    """Whether money is expected to be lost with late ground, beside what is paid."""
    pairs = [(plan.expected_cost, plan.paid_cost) for plan in feasible(ranking)]
    return any(one is not None and other is not None and one - other >= LEAST_MONEY for one, other in pairs)


def area(m2: float) -> str:
    """An area in hectares, or in square metres where it is under a tenth of one."""
    return f"{m2 / 10_000.0:.2f} ha" if m2 >= 1000.0 else f"{m2:.0f} m2"


def area_or_dash(m2: float | None) -> str:
    """The same of an area that may not be known."""
    return NOTHING if m2 is None else area(m2)


def left(plan: PlanResult) -> str | None:
    """What a plan leaves open: ``0.83 ha (17 %)``; None where that is nothing, or not known."""
    if plan.missed_m2 is None or plan.missed_m2 < LEAST_LEFT_M2:
        return None
    share = None if plan.worked_pct is None else 100.0 - plan.worked_pct
    if share is None:
        return area(plan.missed_m2)
    return f"{area(plan.missed_m2)} ({'under 0.1' if share < 0.05 else number(share, 1 if share < 10 else 0)} %)"


def place(piece: MissedPiece) -> str:
    """Where a piece of ground is, on the earth if it is there, else in metres of the field."""
    if piece.lat is None or piece.lon is None:
        return f"x {piece.x_m:.0f} m, y {piece.y_m:.0f} m"
    return f"latitude {piece.lat:.5f}, longitude {piece.lon:.5f}"


def bound(text: str) -> str:
    """The text with spaces that do not break before a value, nor between it and hectares, square metres or percent."""
    return re.sub(r"(?<=[a-z:]) (?=\(?\d)|(?<=\d) (?=ha\b|m2\b|%)", NO_BREAK, text)


def yes_no(value: bool | None) -> str:
    """``yes``, ``no`` or a dash."""
    return NOTHING if value is None else "yes" if value else "no"


def tractors(count: int) -> str:
    """``1 tractor``, ``3 tractors``."""
    return f"{count} tractor" if count == 1 else f"{count} tractors"


def listed(items: Iterable[object], last: str = "and") -> str:
    """``1, 3 and 5``."""
    words = [str(item) for item in items]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}" if words else "none"


def clearance(plan: PlanResult) -> float | None:
    """Smallest distance between two tractors in metres; None for a single one."""
    value = plan.min_clearance_m
    return None if plan.tractors < 2 or value is None or not math.isfinite(value) else value


def feasible(ranking: Ranking) -> list[PlanResult]:
    """The plans that work, in the order of the ranking."""
    return [plan for plan in ranking.plans if plan.feasible]


def refused(ranking: Ranking) -> list[PlanResult]:
    """The plans that do not."""
    return [plan for plan in ranking.plans if not plan.feasible]


def refusals(plans: Sequence[PlanResult]) -> list[Refusal]:
    """Infeasible plans grouped by reason, most frequent first; reasons that differ only in figures are one."""
    groups: dict[str, list[PlanResult]] = {}
    for plan in plans:
        groups.setdefault(_NUMBER.sub("#", _reason(plan)), []).append(plan)
    ordered = sorted(groups.values(), key=len, reverse=True)
    return [
        Refusal(_reason(group[0]), tuple(group), any(_reason(plan) != _reason(group[0]) for plan in group))
        for group in ordered
    ]


def _reason(plan: PlanResult) -> str:
    return (plan.reason or "no reason was given").strip()


def members(refusal: Refusal) -> str:
    """Who was refused: ``row-by-row (omega) with 5 and 7; split-field (u) with 1``."""
    counts: dict[tuple[str, str], list[int]] = {}
    for plan in refusal.plans:
        counts.setdefault((plan.strategy, plan.turn), []).append(plan.tractors)
    return "; ".join(f"{name} ({turn}) with {listed(sorted(set(n)))}" for (name, turn), n in counts.items())


def remarks(plans: Sequence[PlanResult]) -> list[str]:
    """What is remarkable about plans that work, a sentence each: ``row-by-row-optimised with 2 and 3: ... .``"""
    groups: dict[tuple[str, str], list[int]] = {}
    for plan in plans:
        if plan.remark:
            groups.setdefault((plan.strategy, plan.remark), []).append(plan.tractors)
    return [f"{name} with {listed(sorted(set(n)))}: {remark}." for (name, remark), n in groups.items()]


def proven_words(plans: Sequence[PlanResult]) -> str | None:
    """How near the orders of tracks are to the best there can be, a sentence; None where none is proven."""
    groups: dict[str, dict[str, list[int]]] = {}
    for plan in sorted(plans, key=lambda plan: (plan.order_gap_pct or 0.0, plan.tractors)):
        if plan.order_gap_pct is not None:
            groups.setdefault(plan.strategy, {}).setdefault(gap_words(plan.order_gap_pct), []).append(plan.tractors)
    told = [
        f"{name} {listed(f'{words} with {listed(sorted(set(counts)))}' for words, counts in each.items())}"
        for name, each in groups.items()
    ]
    return f"Order of tracks, by the driving between them: {'; '.join(told)}." if told else None


def gap_words(pct: float) -> str:
    """``proven best`` or ``proven within 1.2 %`` of it."""
    return "proven best" if pct < LEAST_GAP_PCT else f"proven within {number(pct, 1)} %"


def machines(ranking: Ranking) -> str | None:
    """What works the field: tractor, and the implement by name, where a farm has one, and width; None if unknown."""
    scenario = ranking.scenario
    if "tractor" not in scenario or "width_m" not in scenario:
        return None
    return f"{scenario['tractor']}, {scenario.get('implement') or 'implement'} {scenario['width_m']:g} m"


def effects_words(ranking: Ranking) -> str | None:
    """What of the tractor file's effects and rest is in use, a sentence; None when it has none."""
    rest = "rest" in ranking.tractor_effects
    parts = [
        f"{both(name)}: {value_words(name, values)}"
        for name, values in ranking.tractor_effects.items() if name != "rest"
    ] + (["a rest told from data"] if rest else [])
    return f"Simulated with what the tractor file has from measured logs: {'; '.join(parts)}." if parts else None


def moment(text: str | None) -> datetime | None:
    """A clock time ``08:00`` or a date and time in ISO 8601; None when it is neither."""
    if text is None:
        return None
    for full in (text.strip(), f"2000-01-01T{text.strip()}", f"2000-01-01T0{text.strip()}"):
        try:
            return datetime.fromisoformat(full)
        except ValueError:
            continue
    return None


def clock(ranking: Ranking, seconds: float | None) -> str | None:
    """The clock, ``09:14``, ``01:14 next day`` or ``01:14, 2 days later``, so long after the start; None for none."""
    start = moment(ranking.start)
    if start is None or seconds is None or not math.isfinite(seconds):
        return None
    later = start + timedelta(seconds=_whole(seconds))
    days = (later.date() - start.date()).days
    return later.strftime("%H:%M") + {0: "", 1: " next day"}.get(days, f", {days} days later")


def begin_s(start: str | None) -> int | None:
    """Seconds of the day at the start; None without one."""
    begin = moment(start)
    return None if begin is None else 3600 * begin.hour + 60 * begin.minute + begin.second


def clock_at(start: str | None, seconds: float) -> str:
    """The clock time ``9:14:05`` so many seconds after the start; without one the seconds as ``h:mm:ss``."""
    begin = begin_s(start)
    return duration(seconds if begin is None else (begin + _whole(seconds)) % DAY_S)


def headline(ranking: Ranking) -> list[str]:
    """The answer in a few sentences: the plan to take, who meets the deadline, what is fastest and cheapest."""
    best = ranking.best
    if best is None:
        return [_no_plan(ranking)]
    is_late = best.meets_deadline is False
    plans = feasible(ranking)
    priced = [plan for plan in plans if plan.cost is not None]
    cheapest = min(priced, key=_money, default=None)
    best_is_cheapest = cheapest is not None and _money(cheapest) == _money(best)
    if ranking.unmet is not None:
        sentences = [ranking.unmet, *_advice_words(ranking), f"The closest: {_told(ranking, best)}."]
        sentences += [*ranking.day, *_left_words(ranking, best), *_remark_words(best)]
    elif not is_late:
        sentences = [*_advice_words(ranking), f"Best plan: {_told(ranking, best)}."]
        sentences += [*ranking.day, *_left_words(ranking, best), *_remark_words(best)]
        sentences += _deadline_words(ranking, best, best_is_cheapest)
    else:
        by = "" if ranking.missed_by_s is None else f" misses it by {duration(ranking.missed_by_s)}"
        sentences = [f"No plan meets {_deadline_name(ranking, 'the')}.", *_advice_words(ranking)]
        sentences += [f"The {closest(ranking)}{by}: {_told(ranking, best)}."]
        sentences += [*ranking.day, *_left_words(ranking, best), *_remark_words(best)]
    if ranking.cut_off_m2:
        sentences.append(f"Obstacles cut off {area(ranking.cut_off_m2)} of the field, which no plan works.")
    return sentences + _others_words(ranking, best, cheapest, best_is_cheapest)


def _others_words(
    ranking: Ranking, best: PlanResult, cheapest: PlanResult | None, best_is_cheapest: bool
) -> list[str]:
    """The fastest and the cheapest plan where that is another, or that it is the best itself."""
    plans, late = feasible(ranking), late_counts(ranking)
    fastest = min((plan for plan in plans if plan.time_s is not None), key=finish_s, default=best)
    told = {}
    if fastest is not best and finish_s(fastest) != finish_s(best):
        told["Fastest"] = fastest
    if cheapest is not None and not best_is_cheapest:
        told["Least expected cost" if late else "Cheapest"] = cheapest
    if len(told) == 2 and fastest is cheapest:
        told = {"Fastest, at the least expected cost" if late else "Fastest and cheapest": fastest}
    sentences = [f"{name}: {_told(ranking, plan)}." for name, plan in told.items()]
    if not best_is_cheapest or best.meets_deadline:
        return sentences
    which = "also has the least expected cost" if late else "is also the cheapest"
    closest_only = best.meets_deadline is False or ranking.unmet is not None
    return [*sentences, f"{'That' if closest_only else 'The best plan'} {which}."]


def _money(plan: PlanResult) -> float:
    """What plans are compared by: the expected cost, without draws that of the finished field."""
    return finish_cost(plan) if plan.expected_cost is None else plan.expected_cost


def _advice_words(ranking: Ranking) -> list[str]:
    """The advice, and what its figures of money are."""
    return [] if ranking.advice is None else [ranking.advice, *ranking.money]


def _told(ranking: Ranking, plan: PlanResult) -> str:
    leaves = "" if left(plan) is None else f", leaves {left(plan)}"
    done = "done in" if abs((plan.time_s or 0.0) - done_s(plan)) < SAME_S else "driven in"
    when = _when(ranking, plan.time_s, done_s(plan))
    return f"{_what(plan)}, {done} {when}{_refills(plan)}{_at_cost(ranking, plan)}{leaves}"


def _refills(plan: PlanResult) -> str:
    """`` with 3 refills``; nothing where nothing is carried."""
    if plan.refills is None:
        return ""
    return f" with {plan.refills or 'no'} refill{'' if plan.refills == 1 else 's'}"


def closest(ranking: Ranking) -> str:
    """What to call the best plan where none meets the deadline: another may be done sooner but leave more open."""
    best = ranking.best
    times = [plan.time_s for plan in feasible(ranking) if plan.time_s is not None]
    return "closest" if best is None or best.time_s is None or best.time_s <= min(times) else "best of them"


def _left_words(ranking: Ranking, plan: PlanResult) -> list[str]:
    """What finishing the ground that a plan leaves would come to, and where the largest piece of it is."""
    if left(plan) is None:
        return []
    late = plan.meets_deadline and ranking.allowed_s is not None and finished_done_s(plan) > ranking.allowed_s
    said = f"With that finished at its own rate: {_when(ranking, plan.finished_s, finished_done_s(plan))}"
    said += _finished_cost(ranking, plan)
    said += ", too late for the deadline" if late else ""
    sentences = [] if plan.finished_s is None else [f"{said}."]
    if plan.largest_missed is not None:
        piece = plan.largest_missed
        sentences.append(f"The largest piece it leaves, {area(piece.m2)}, is at {place(piece)}.")
    return sentences


def _finished_cost(ranking: Ranking, plan: PlanResult) -> str:
    """What the finished field costs; with draws what it costs more, as these are of the ground that is worked."""
    if plan.finished_cost is None:
        return ""
    if plan.expected_cost is None:
        return f", cost {_in_currency(ranking, plan.finished_cost)}"
    more = plan.finished_cost - (plan.cost or 0.0)
    return f", {_in_currency(ranking, more)} more" if more >= LEAST_MONEY else ""


def _remark_words(plan: PlanResult) -> list[str]:
    """What is remarkable about the plan that is told first, such as how little of the field it works."""
    return [f"Remark on it: {plan.remark}."] if plan.remark else []


def _no_plan(ranking: Ranking) -> str:
    if not ranking.plans:
        return "No plan was tried: allow at least one strategy, turn and number of tractors."
    first = refusals(ranking.plans)[0]
    figures = " (the figures are those of the first)" if first.alike else ""
    return f"No plan works: {_refused_words(len(ranking.plans), first)}: {first.reason.rstrip('.')}{figures}."


def _refused_words(count: int, first: Refusal) -> str:
    """How many were refused and how many for the reason that follows: ``both were refused because``."""
    alike = len(first.plans)
    everyone = {1: "the only one was", 2: "both were"}.get(count, f"all {count} were")
    share = "" if alike == count else f", {'one' if alike == 1 else alike} of them"
    return f"{everyone} refused{share} because"


def _what(plan: PlanResult) -> str:
    return f"{tractors(plan.tractors)}, {plan.strategy}, turns {plan.turn}"


def _when(ranking: Ranking, seconds: float | None, by_clock_s: float) -> str:
    """The time driven, and the clock; where the way back, the road or breaks part them, what the clock is of."""
    at = clock(ranking, by_clock_s)
    of = "" if abs((seconds or 0.0) - by_clock_s) < SAME_S else "field work done "
    return duration(seconds) + (f" ({of}at {at})" if at else "")


def _at_cost(ranking: Ranking, plan: PlanResult) -> str:
    if plan.expected_cost is not None:
        return f", {'expected ' if late_counts(ranking) else ''}cost {_in_currency(ranking, plan.expected_cost)}"
    return "" if plan.cost is None else f", cost {_in_currency(ranking, plan.cost)}"


def _in_currency(ranking: Ranking, value: float) -> str:
    return price(value) if ranking.currency is None else f"{price(value)} {ranking.currency}"


def _deadline_name(ranking: Ranking, article: str) -> str:
    at = clock(ranking, ranking.allowed_s) or ranking.before
    return f"{article} deadline ({at})" if at else f"{article} deadline"


def _deadline_words(ranking: Ranking, best: PlanResult, best_is_cheapest: bool) -> list[str]:
    """Who meets the deadline, and that the best plan is the cheapest of those or of all plans."""
    judged = [plan for plan in feasible(ranking) if plan.meets_deadline is not None]
    if not judged:
        return []
    name = _deadline_name(ranking, "The")
    meeting = sorted({plan.tractors for plan in judged if plan.meets_deadline})
    late = sorted({plan.tractors for plan in judged} - set(meeting))
    missed = f", not with {listed(late, 'or')}" if late else ""
    noun = "tractor" if meeting == [1] else "tractors"
    if ranking.chosen is not None:
        return [f"{name} can be met with {listed(meeting, 'or')} {noun}{missed}, as simulated."]
    least = min(finish_cost(plan) for plan in judged if plan.meets_deadline)
    among = "of all" if best_is_cheapest else "of them"
    if finish_cost(best) > least:
        among = "that could finish the field by then"
    return [f"{name} can be met with {listed(meeting, 'or')} {noun}{missed}; the best plan is the cheapest {among}."]
