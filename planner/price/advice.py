"""The choice between plans in one sentence: what is advised, and what one tractor fewer and one more would change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from planner.price.choice import Figures, best, best_by_count, same_chance, same_draws, same_money, same_time
from planner.scenario import CHEAPEST, FASTEST, SUREST
from reports.wording import is_wide, price

_COUNTS = ("No tractor", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine", "Ten")
_ORDINALS = ("", "first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
LEAST_MONEY = 0.005
LARGE = 999.995  # from here on money is printed without decimals
MINUTE_S = 60.0
EQUAL = ", as good as equal,"
BETTER, NEITHER, WORSE = 1, 0, -1


def advice(
    plans: Sequence[Figures], limit: str = "", prefer: str = CHEAPEST, taken: tuple[str, int] | None = None,
    budget: float | None = None,
) -> str:  # fmt: skip
    """The sentence for feasible plans, "" without any.

    `limit` says when work must be done, as "before 17:00" or "before the rain"; `taken` is the plan that was chosen
    (strategy, tractors) where that is known, and what is dearer than a `budget` is said to be. What is preferred comes
    first, in the figure that it is chosen by: the expected cost (`Figures.expected`), the time, or how sure it is; what
    is too near in that to be told apart is called equal. Differences are those of the figures as they are printed, and
    how sure a plan is has its interval where draws are few. Example: "2 tractors: 97 % before 17:00, 128.90 expected
    (120.10 paid). One saves 1.50, as good as equal, but finishes in time only 61 % of the time; a third adds 9.40 and
    2 %."
    """
    if not plans:
        return ""
    known = next((plan for plan in plans if (plan.strategy, plan.tractors) == taken), None)
    chosen, by_count = known or best(plans, prefer), best_by_count(plans, prefer)
    fewer = max((count for count in by_count if count < chosen.tractors), default=None)
    more = min((count for count in by_count if count > chosen.tractors), default=None)
    others = [by_count[count] for count in (fewer, more) if count is not None]
    parts = [_change(other, chosen, prefer) + _over(other, budget) for other in others]
    headline = f"{_tractors(chosen.tractors)}: {_certainty(chosen, limit, prefer)}, {_price(chosen)}."
    if not parts:
        return headline
    return f"{headline} {parts[0][0].upper() + parts[0][1:]}{''.join(f'; {part}' for part in parts[1:])}."


def percent(share: float) -> str:
    """A probability in whole percent; what is neither certain nor impossible is not rounded to it."""
    if 0.995 <= share < 1.0:
        return "over 99 %"
    if 0.0 < share < 0.005:
        return "under 1 %"
    return f"{100.0 * share:.0f} %"


def hours(seconds: float) -> str:
    """A time to the minute."""
    minutes = round(seconds / MINUTE_S)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min"


def chance(plan: Figures) -> str:
    """How sure a plan is: ``97 %``, or ``77 % (68 to 84 %)`` with its 95 % interval where draws are few."""
    share = percent(plan.probability or 0.0)
    if not is_wide(plan.interval) or plan.interval is None:
        return share
    low, high = (f"{100.0 * end:.0f}" for end in plan.interval)
    return f"{share} ({low} to {high} %)"


def _tractors(count: int) -> str:
    return f"{count} tractor{'s' if count > 1 else ''}"


def _certainty(plan: Figures, limit: str, prefer: str) -> str:
    half = f"{hours(plan.p50_s)} or less half of the time"
    if plan.probability is None:
        return f"{half}, {hours(plan.p95_s)} or less 95 % of the time"
    sure = f"{chance(plan)} {limit or 'in time'}"
    return f"{half}, {sure}" if prefer == FASTEST else sure


def _over(plan: Figures, budget: float | None) -> str:
    return "" if budget is None or plan.paid <= budget else ", over the budget"


def _price(plan: Figures) -> str:
    """What is expected, and of that what is paid where ground may be late."""
    if abs(plan.expected - plan.paid) < LEAST_MONEY:
        return price(plan.paid)
    return f"{price(plan.expected)} expected ({price(plan.paid)} paid)"


@dataclass(frozen=True)
class _Told:
    """What another fleet changes in one figure: in words, and whether for the better."""

    words: str
    sign: int


def _change(plan: Figures, chosen: Figures, prefer: str) -> str:
    """What fewer or more tractors would change: first in what is preferred."""
    fewer = plan.tractors < chosen.tractors
    one = plan.tractors == 1 if fewer else plan.tractors == chosen.tractors + 1 and plan.tractors < len(_ORDINALS)
    limited = plan.probability is not None and chosen.probability is not None
    money = _money(plan, chosen, one, told=prefer == CHEAPEST)
    time = _slower(plan, chosen, one, prefer)
    if prefer == FASTEST:
        first, second = time, money
    elif prefer == SUREST:
        first, second = _sure(plan, chosen, one) if limited else time, money
    else:
        first, second = money, _surer(plan, chosen, one) if limited else time
    joint = "but" if first.sign * second.sign < 0 else "and"
    return f"{_who(plan, fewer, one)} {first.words} {joint} {second.words}"


def _who(plan: Figures, fewer: bool, one: bool) -> str:
    if fewer:
        return _COUNTS[plan.tractors].lower() if plan.tractors < len(_COUNTS) else str(plan.tractors)
    return f"a{'n' if plan.tractors == 8 else ''} {_ORDINALS[plan.tractors]}" if one else _tractors(plan.tractors)


def _money(plan: Figures, chosen: Figures, one: bool, *, told: bool) -> _Told:
    """More money ("costs 1.50 more", "adds 1.50"), less ("saves 1.50"), or none; near is `told` to be equal."""
    added = _added(plan, chosen)
    if added == 0.0:
        return _Told(f"{_verb('cost', one)} the same", NEITHER)
    equal = EQUAL if told and same_money(plan, chosen) else ""
    if added < 0.0:
        return _Told(f"{_verb('save', one)} {price(-added)}{equal}", BETTER)
    fewer = plan.tractors < chosen.tractors
    words = f"{_verb('cost', one)} {price(added)} more" if fewer else f"{_verb('add', one)} {price(added)}"
    return _Told(words + equal, WORSE)


def _added(plan: Figures, chosen: Figures) -> float:
    """By how much its expected cost is above another, of both as they are printed: whole units from 1000 on."""
    decimals = 2 if max(plan.expected, chosen.expected) < LARGE else 0
    return round(round(plan.expected, decimals) - round(chosen.expected, decimals), decimals)


def _surer(plan: Figures, chosen: Figures, one: bool) -> _Told:
    """How much surer it is, beside its money: more tractors in percent on top."""
    points = round(100.0 * (plan.probability or 0.0)) - round(100.0 * (chosen.probability or 0.0))
    if is_wide(plan.interval) and same_draws(plan, chosen):
        if plan.tractors < chosen.tractors:
            return _Told(f"{'is' if one else 'are'} as sure, as far as {chosen.draws} draws can tell", NEITHER)
        return _Told(f"no certainty that {chosen.draws} draws could tell", NEITHER)
    if plan.tractors < chosen.tractors:
        return _sure(plan, chosen, one, told=False)
    added = _added(plan, chosen) > 0.0
    if points == 0:
        return _Told("no certainty" if added else "nothing else changes", NEITHER)
    if added and points > 0:
        return _Told(f"{points} %", NEITHER)
    return _Told(f"{_verb('add' if points > 0 else 'lose', one)} {abs(points)} %", BETTER if points > 0 else WORSE)


def _sure(plan: Figures, chosen: Figures, one: bool, *, told: bool = True) -> _Told:
    """How often it finishes in time; near is `told` to be equal."""
    own, other = plan.probability or 0.0, chosen.probability or 0.0
    if percent(own) == percent(other):
        return _Told(f"{'is' if one else 'are'} as sure", NEITHER)
    equal = EQUAL if told and same_chance(plan, chosen) else ""
    only = "only " if own < other else ""
    words = f"{_verb('finish', one)} in time {only}{chance(plan)} of the time{equal}"
    words = words if own > 0.0 else f"{_verb('finish', one)} in time in none of the draws{equal}"
    return _Told(words, WORSE if own < other else BETTER)


def _slower(plan: Figures, chosen: Figures, one: bool, prefer: str) -> _Told:
    """How much longer or less long it takes, as often as not or, where the surest is preferred, at 95 %."""
    own, other = (plan.p95_s, chosen.p95_s) if prefer == SUREST else (plan.p50_s, chosen.p50_s)
    slower = own - other
    if abs(slower) < 0.5 * MINUTE_S:
        return _Told(f"{_verb('take', one)} as long", NEITHER)
    equal = EQUAL if prefer != CHEAPEST and same_time(own, other) else ""
    words = f"{_verb('take', one)} {hours(abs(slower))} {'longer' if slower > 0.0 else 'less'}{equal}"
    return _Told(words, WORSE if slower > 0.0 else BETTER)


def _verb(word: str, one: bool) -> str:
    """A verb for one or several."""
    return word if not one else f"{word}es" if word.endswith("sh") else f"{word}s"
