"""Effects of the catalogue drawn for the first and the second reference, whose truths draw no cases themselves.

A seed of the second has 80 sets: each effect alone at a clear size, at half and at a third of it; pairs of effects from
every two of the four blocks; triples from every three; and sets with nothing hidden. Tractors take turns from set to
set and from seed to seed, so that two seeds in a row show every set on both. The first has each effect alone at a clear
size and at a third of it, and nothing hidden, on one tractor; causes outside of the catalogue; drives that go one way
only; and logs at two rates with uneven steps and gaps. Sizes are drawn up to a quarter above the share of the
clear size, signs and places wherever there are any.
"""

from dataclasses import replace
from itertools import combinations, combinations_with_replacement, product
from zlib import crc32

import numpy as np

from tests.truth.cases import TruthCase
from tests.truth.drawing import EITHER_WAY
from tests.truth.effects import CLEAR_SIZES, NEUTRAL, OUTSIDE
from tests.truth.effects import scaled as scale_effect

SIZES = {"clear": 1.0, "half": 0.5, "third": 1.0 / 3.0}
BLOCKS = {
    "command to wheel": ("steering_dead_time", "steering_lag", "steering_rate", "steering_deadband"),
    "wheel to path": (
        "steering_offset", "steering_gain", "steering_asymmetry", "steering_backlash", "side_slip", "understeer",
        "cross_slope_drift", "implement_side_draft", "grip_patch", "grip_drift",
    ),
    "speed": ("wheel_slip", "implement_slip", "speed_lag"),
    "position": ("antenna_forward", "antenna_right", "gnss_latency", "heading_bias"),
}  # fmt: skip
MOST_ABOVE, SPREAD_M, EMPTY_SETS = 1.25, 6.0, 3
ONE_WAY = ("steering_offset", "implement_side_draft", "cross_slope_drift", "heading_bias")
UNEVEN = ("steering_offset", "steering_dead_time", "implement_slip", "gnss_latency", "cross_slope_drift")
HINT_WORDS = {
    "steering_temperature": ("time",), "steering_wobble": ("time",), "speed_pull": ("speed",),
    "wind_drift": ("direction of travel",),
}  # fmt: skip
"""What a hint should say; a relaxing tyre is below the noise of these drives: nothing need be said of it."""
What = tuple[tuple[str, ...], str]
"""Names of effects and one of SIZES."""


def list_single_effects(sizes: tuple[str, ...]) -> list[What]:
    """Each effect alone at each of the sizes, and nothing."""
    return [((name,), size) for size in sizes for name in CLEAR_SIZES] + [((), "clear")] * EMPTY_SETS


def list_special_cases(seed: int) -> list[TruthCase]:
    """Causes outside of the catalogue, drives of one way only, and logs at low and uneven rates."""
    cases = [
        TruthCase("outside", seed, outside={name: values}, hint_words=HINT_WORDS.get(name, ()), programme="default")
        for name, values in OUTSIDE.items()
    ]
    for name in ONE_WAY:
        drawn = make_drawn_case(((name,), "clear"), seed, "one way")
        allowed = drawn.allowed | frozenset(ONE_WAY)
        cases.append(replace(drawn, kind="one_sided", programme="one_way", allowed=allowed))
    for name, rate_hz in product(UNEVEN, (5.0, 10.0)):
        drawn = make_drawn_case(((name,), "clear"), seed, f"{rate_hz:g} Hz")
        cases.append(replace(drawn, rate_hz=rate_hz, programme="uneven"))
    return cases


def list_combined_effects(seed: int) -> list[What]:
    """Clear effects of every two and every three blocks."""
    rng, what = np.random.default_rng([seed, 21]), list[What]()
    for count, choose in ((2, combinations_with_replacement), (3, combinations)):
        what += [(choose_one_of_each(blocks, rng), "clear") for blocks in choose(BLOCKS, count)]
    return what


def choose_one_of_each(blocks: tuple[str, ...], rng: np.random.Generator) -> tuple[str, ...]:
    """An effect of each block, never one twice."""
    while True:
        names = tuple(str(rng.choice(BLOCKS[block])) for block in blocks)
        if len(set(names)) == len(names):
            return names


def make_drawn_case(what: What, seed: int, label: str) -> TruthCase:
    """A case with the effects at about their size; a name is wanted of clear ones only."""
    names, size = what
    rng = np.random.default_rng([seed, crc32(f"{'+'.join(names)} {label}".encode())])
    effects = {name: draw_values(name, SIZES[size] * float(rng.uniform(1.0, MOST_ABOVE)), rng) for name in names}
    ids = frozenset(names)
    kind = ("clean", "effect", "pair", "pair")[len(names)]
    return TruthCase(kind, seed, effects, allowed=ids, wanted=ids if size == "clear" else frozenset())


def draw_values(name: str, share: float, rng: np.random.Generator) -> dict[str, float]:
    """An effect at a share of its clear size, to either side where it has two, somewhere in the field."""
    values = scale_effect(name, share)
    if name in EITHER_WAY and rng.random() < 0.5:
        values = {key: 2.0 * NEUTRAL[name][key] - value for key, value in values.items()}
    for key in values:
        if key == "bearing_deg":
            values[key] = float(rng.uniform(0.0, 360.0))
        elif key in ("east_m", "north_m"):
            values[key] += float(rng.uniform(-SPREAD_M, SPREAD_M))
    return values
