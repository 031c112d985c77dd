"""What a truth hides: effects, clocks of columns, laws of parameters, faults that begin, causes outside the catalogue.

A case says what is hidden and what may rightly be said of it; each reference that builds cases makes its logs from it.

Kinds of a law, and the keys of its values (`value` is in the unit of the effect's first parameter):

| kind | keys | value |
|---|---|---|
| constant | value | value |
| over_minutes | start, per_minute | start + per_minute * minutes since the first row of the run |
| over_day | mean, amplitude, period_s, phase_deg | mean + amplitude * sin(360 t / period_s + phase_deg), t of the day |
| by_place | at_origin, per_m_east, per_m_north | a gradient over the field |
| by_place | inside, outside, east_m, north_m, radius_m | a patch |
| by_run | run, value, other | `value` in the run of this index, `other` in all others |
| by_implement | lifted, working | by the switch of the implement |
| by_side | left, right | by the side to which the wheels stand, or move (rates), or are to move (dead bands) |
| by_angle | at_0, at_27 | linear in the size of the wheel angle, and held beyond 27 degrees |
| by_speed | at_0, per_mps | at_0 + per_mps * speed |

Details of a fault: `side` (1 right, -1 left) of steering_stuck; `mode` (0 degrades, 1 jumps, 2 freezes) and `size_m`
(standard deviation, or jump) of position_lost. Seconds count from the first row of the run.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field

from tests.truth.effects import NEUTRAL, Effects

KINDS = (
    "clean", "effect", "pair", "closed_loop", "column", "law", "fault", "outside", "odd_run", "one_sided", "one_speed",
    "mixed",
)  # fmt: skip
COLUMN_NAMES = ("position", "heading", "speed", "steering", "steering_command")
LAW_KINDS = (
    "constant", "over_minutes", "over_day", "by_place", "by_run", "by_implement", "by_side", "by_angle", "by_speed",
)  # fmt: skip
FAULT_IDS = (
    "steering_loose", "steering_stuck", "position_lost", "position_frozen", "heading_frozen", "speed_frozen",
    "wheel_sensor_frozen",
)  # fmt: skip
COLUMN_IDS = (
    "position_delay", "heading_delay", "heading_filter", "speed_scale",
    *(f"clock_offset_{name}" for name in COLUMN_NAMES),
)  # fmt: skip
CAUSE_IDS = frozenset((*NEUTRAL, *COLUMN_IDS, *FAULT_IDS))


@dataclass(frozen=True)
class ColumnClock:
    """How a column is older than its rows, or another size than what it measures.

    In the order in which they act: low-passed (first order, `filter_s`), `delay_s` old, stamped `offset_s` (plus
    `drift_s_per_min` since the start of the run) by another clock, refreshed every `hold_s` only (each time longer or
    shorter by up to the share `hold_jitter`), the value repeated in between. Positive delays and offsets: a row holds
    what was true so long ago; offsets may be negative. `scale` multiplies the value; it is for speed and wheel angle.
    """

    delay_s: float = 0.0
    hold_s: float = 0.0
    hold_jitter: float = 0.0
    filter_s: float = 0.0
    offset_s: float = 0.0
    drift_s_per_min: float = 0.0
    scale: float = 1.0


@dataclass(frozen=True)
class Law:
    """The value of an effect's first parameter as a function; kinds and keys as in the table above."""

    effect: str
    kind: str
    values: Mapping[str, float]


@dataclass(frozen=True)
class Fault:
    """Something that breaks in run `run` (index) at `from_s` and heals at `to_s`, or never (None)."""

    id: str
    run: int
    from_s: float
    to_s: float | None = None
    detail: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class TruthCase:
    """All that is hidden in one set of logs, and what a diagnosis may say of it.

    `effects` as in tests.truth.effects; `outside` maps names of causes without an id to their values; `programme` names
    the runs. `allowed` are the ids that may rightly be named, `wanted` those that a good diagnosis names or puts into
    an equivalent set; of `hint_words` one should be in a hint. Raises ValueError for an unknown kind, id or column.
    """

    kind: str
    seed: int
    effects: Effects = field(default_factory=dict)
    columns: Mapping[str, ColumnClock] = field(default_factory=dict)
    laws: tuple[Law, ...] = ()
    faults: tuple[Fault, ...] = ()
    outside: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    programme: str = "three_speeds"
    rate_hz: float = 10.0
    allowed: frozenset[str] = frozenset()
    wanted: frozenset[str] = frozenset()
    hint_words: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _require((self.kind,), KINDS, "kind")
        _require(self.columns, COLUMN_NAMES, "column")
        _require((law.kind for law in self.laws), LAW_KINDS, "law")
        _require((fault.id for fault in self.faults), FAULT_IDS, "fault")
        _require((*self.effects, *(law.effect for law in self.laws)), NEUTRAL, "effect")
        _require(self.allowed | self.wanted, CAUSE_IDS, "cause")


def _require(names: Iterable[str], known: Collection[str], what: str) -> None:
    unknown = sorted(set(names) - set(known))
    if unknown:
        raise ValueError(f"The {what} {unknown[0]!r} is unknown; use one of: {', '.join(sorted(known))}.")
