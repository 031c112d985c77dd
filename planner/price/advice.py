"""The choice between plans in one sentence: what is advised, and what one tractor fewer and one more would change."""

from __future__ import annotations

from collections.abc import Sequence

from planner.price.choice import Figures, best, best_by_count
from planner.scenario import CHEAPEST

_COUNTS = ("No tractor", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine", "Ten")
_ORDINALS = ("", "first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
LEAST_MONEY = 0.005
MINUTE_S = 60.0


def advice(
    plans: Sequence[Figures], limit: str = "", prefer: str = CHEAPEST, taken: tuple[str, int] | None = None
) -> str:
    """The sentence for feasible plans, "" without any.

    `limit` says when work must be done, as "before 17:00" or "before the rain". Money is what is paid; the choice also
    counts late ground (`Figures.expected`); `taken` is the plan that was chosen (strategy, tractors) where that is
    known. Example: "2 tractors: 97 % before 17:00, 128.90. One saves 1.50 but
    finishes in time only 61 % of the time; a third adds 9.40 and 2 %."
    """
    if not plans:
        return ""
    known = next((plan for plan in plans if (plan.strategy, plan.tractors) == taken), None)
    chosen, by_count = known or best(plans, prefer), best_by_count(plans, prefer)
    fewer = max((count for count in by_count if count < chosen.tractors), default=None)
    more = min((count for count in by_count if count > chosen.tractors), default=None)
    parts = [] if fewer is None else [_fewer(by_count[fewer], chosen)]
    if more is not None:
        part = _more(by_count[more], chosen)
        parts.append(part if parts else part[0].upper() + part[1:])
    headline = f"{_tractors(chosen.tractors)}: {_certainty(chosen, limit)}, {chosen.paid:.2f}."
    return f"{headline} {'; '.join(parts)}." if parts else headline


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


def _tractors(count: int) -> str:
    return f"{count} tractor{'s' if count > 1 else ''}"


def _certainty(plan: Figures, limit: str) -> str:
    if plan.probability is None:
        return f"{hours(plan.p50_s)} as often as not, {hours(plan.p95_s)} at 95 %"
    return f"{percent(plan.probability)} {limit or 'in time'}"


def _fewer(plan: Figures, chosen: Figures) -> str:
    """What fewer tractors would change."""
    one = plan.tractors == 1
    who = _COUNTS[plan.tractors] if plan.tractors < len(_COUNTS) else str(plan.tractors)
    saved = chosen.paid - plan.paid
    money = f"{who} {_paying(-saved, one)}"
    if plan.probability is None or chosen.probability is None:
        slower = plan.p50_s - chosen.p50_s
        joint = "but" if slower > 0.0 and saved > -LEAST_MONEY else "and"
        return f"{money} {joint} {_verb('take', one)} {_time(slower)}"
    if percent(plan.probability) == percent(chosen.probability):
        return f"{money} and {'is' if one else 'are'} as sure"
    worse = plan.probability < chosen.probability
    joint = "but" if worse and saved > -LEAST_MONEY else "and"
    only = "only " if worse else ""
    return f"{money} {joint} {_verb('finish', one)} in time {only}{percent(plan.probability)} of the time"


def _more(plan: Figures, chosen: Figures) -> str:
    """What more tractors would change."""
    one = plan.tractors == chosen.tractors + 1 and plan.tractors < len(_ORDINALS)
    who = f"a{'n' if plan.tractors == 8 else ''} {_ORDINALS[plan.tractors]}" if one else _tractors(plan.tractors)
    added = plan.paid - chosen.paid
    money = f"{who} {_paying(added, one, 'add')}"
    if plan.probability is None or chosen.probability is None:
        return f"{money} and {_verb('take', one)} {_time(plan.p50_s - chosen.p50_s)}"
    points = round(100.0 * plan.probability) - round(100.0 * chosen.probability)
    if points == 0:
        return f"{money} and {'no certainty' if added > LEAST_MONEY else 'nothing else changes'}"
    if added > LEAST_MONEY and points > 0:
        return f"{money} and {points} %"
    return f"{money} {'and' if points > 0 else 'but'} {_verb('add' if points > 0 else 'lose', one)} {abs(points)} %"


def _verb(word: str, one: bool) -> str:
    """A verb for one or several."""
    return word if not one else f"{word}es" if word.endswith("sh") else f"{word}s"


def _paying(added: float, one: bool, word: str = "cost") -> str:
    """More money ("costs 1.50 more", "adds 1.50"), less ("saves 1.50"), or none."""
    if abs(added) < LEAST_MONEY:
        return f"{_verb('cost', one)} the same"
    if added < 0.0:
        return f"{_verb('save', one)} {-added:.2f}"
    return f"{_verb(word, one)} {added:.2f}{' more' if word == 'cost' else ''}"


def _time(slower_s: float) -> str:
    """How much longer or less long."""
    if abs(slower_s) < 0.5 * MINUTE_S:
        return "as long"
    return f"{hours(abs(slower_s))} {'longer' if slower_s > 0.0 else 'less'}"
