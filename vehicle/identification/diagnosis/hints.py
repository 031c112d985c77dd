"""Hints where an error has no name: what it depends on, and which instrument or block of the chain shows it.

A hint is no cause. What a fit has no cause for it calls noise, so it is looked for with noise no larger than ground and
instruments make: laws that would explain it come first, then the instrument that is louder than it may be, then where
the error is larger.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import rankdata

from vehicle.identification.diagnosis.drive_data import PATH_STEP_S
from vehicle.identification.diagnosis.grammar import LAW_WORDS, PENALTIES, Coordinate, Hypothesis
from vehicle.identification.diagnosis.model_fit import Fit, Problem
from vehicle.identification.diagnosis.noise import POSE_PARTS
from vehicle.identification.diagnosis.noise_floor import Unexplained, limit_noise
from vehicle.identification.diagnosis.results import Hint
from vehicle.identification.diagnosis.search import ADD_NATS, Judgement, Searcher
from vehicle.identification.logs.schema import Array
from vehicle.identification.logs.thresholds import CLEAR_SIGMAS, SURE_SIGMAS
from vehicle.model.effects import PATH, get_effect

MOST_HINTS, MOST_TRIED = 4, 3  # chosen: a longer list is of no use to a reader; laws of a scan that are fitted
# Mean square of whitened residuals with noise that is still noise: eleven clean sets have 1.1, 1.9 with misjudged crab.
LOUD_SQUARE = 1.5
LOUD_RATIO = 1.5  # of the noise to its limit, from which a part of it is part of what is too loud
CLUE_TIMES = 2.0  # errors in the third of windows where they are larger over the other: noise shows up to 1.9
FEWEST_CLUE_WINDOWS = 12  # chosen: ranks of fewer windows show nothing
DEG = math.radians(1.0)
QUANTITY_WORDS = {
    "speed": "speed",
    "angle": "the size of the wheel angle",
    "implement": "the implement",
    "minutes": "the driving time",
    "to_east": "the direction of travel",
    "to_north": "the direction of travel",
    "east": "the place, east to west",
    "north": "the place, north to south",
    "lateral": "lateral acceleration",
    "turning": "the rate of turning",
    "accelerating": "changes of speed",
}
# Where a quantity is large, and where it is small.
WHERE_WORDS = {
    "speed": ("at high speed", "at low speed"),
    "angle": ("in tight bends", "near straight ahead"),
    "implement": ("with the implement working", "with the implement lifted"),
    "minutes": ("late in the runs", "early in the runs"),
    "to_east": ("on the way east", "on the way west"),
    "to_north": ("on the way north", "on the way south"),
    "east": ("in the east", "in the west"),
    "north": ("in the north", "in the south"),
}
CHANNEL_WORDS = {"pose": ("position", "the positions"), "wheel": ("steering", "the wheel angle"),
                 "speed": ("speed", "the speed")}  # fmt: skip


@dataclass(frozen=True)
class Change:
    """What an error may look like: words, the field of the model, a usual size of it, and the least that is told, as
    root mean squares in the unit of the field; `instrument` or `block` shows it, `keys` are what it may depend on."""

    words: str
    field: str
    width: float
    least: float
    instrument: str | None
    block: str | None
    keys: tuple[str, ...]


GROUND_KEYS = ("speed", "implement", "minutes", "to_east", "to_north", "east", "north", "lateral")
# The least sizes are half more than the largest in eleven clean sets of three truths by other hands.
CHANGES = (
    Change("an extra wheel angle", "offset", 0.75 * DEG, 0.2 * DEG, None, PATH, GROUND_KEYS),
    Change("a change of grip", "bend", 0.1, 0.03, None, PATH, (*GROUND_KEYS, "angle")),
    Change("an error of the headings", "heading_bias", DEG, 0.45 * DEG, "heading", None,
           ("speed", "minutes", "to_east", "to_north", "east", "north", "lateral", "turning")),
    Change("an antenna displaced lengthwise", "shift_forward", 0.2, 0.02, "position", None,
           ("accelerating", "lateral", "turning")),
    Change("an antenna displaced sideways", "shift_right", 0.2, 0.02, "position", None,
           ("lateral", "turning", "minutes", "east", "north")),
    Change("a change of the distance driven", "speed_scale", 0.03, 0.005, "speed", None,
           ("speed", "angle", "implement", "minutes", "to_east", "to_north", "east", "north")),
)  # fmt: skip
# Words where the noise of a pose is too loud, by what its loudest part does.
LOUD_POSE = {
    "position": Hint(None, "position", None, "The positions wander within seconds while headings and wheel angles "
                     "agree, as of a receiver without a fix, of trees, or of an antenna that sways."),
    "heading": Hint(None, "heading", None, "The headings leave the direction of the path within seconds, as of a "
                    "gyroscope whose scale is off or of a compass near iron."),
    "speed": Hint("speed", "speed", None, "The distance driven is not what the measured speed says, and changes "
                  "within seconds: look at the speed sensor and at what makes wheels slip."),
    "path": Hint(None, None, PATH, "The vehicle turns otherwise than its wheel angle says, changing within seconds: "
                 "look at the place, the ground, the tyres and the axle."),
}  # fmt: skip
LOUD_SENSOR = {
    "wheel": Hint(None, "steering", None, "The wheel angle follows its command otherwise than any steering system "
                  "that is known: look at its valve, its joints and its sensor."),
    "speed": Hint("speed", "speed", None, "The speed follows its command otherwise than any drive line that is known: "
                  "look at what slows the tractor."),
}  # fmt: skip


def find_hints(
    problem: Problem, fit: Fit, judgements: Sequence[Judgement], unexplained: Unexplained
) -> tuple[Hint, ...]:
    """Hints on what a fit leaves; one sentence each, the most telling first. The noise of the problem is kept."""
    noise = problem.get_noise()
    hints = list(list_law_hints(judgements))
    try:
        limits = limit_noise(problem)
        problem.set_noise({channel: 2.0 * np.log(sizes) for channel, sizes in limits.items()})
        rest = problem.refit(fit.model, fit.amounts, 2)
        quantities = list_quantities(problem)
        hints += find_laws(problem, rest, quantities)
        if unexplained.above_s:
            white, _ = problem.weigh(rest.residuals)
            counts = {channel: one.counts for channel, one in problem.noise.items()}
            squares = {channel: (own * own).sum(axis=1)[counts[channel] > 0] / counts[channel][counts[channel] > 0]
                       for channel, own in white.items()}  # fmt: skip
            hints += list_loud(squares, {channel: np.exp(0.5 * noise[channel]) / limits[channel] for channel in noise})
            hints += list_clues(problem, squares, quantities)
    finally:
        problem.set_noise(noise)
    return tuple({hint.words: hint for hint in hints}.values())[:MOST_HINTS]


def list_law_hints(judgements: Sequence[Judgement]) -> Iterator[Hint]:
    """Laws of effects that predict left-out driving clearly, which no tractor file holds."""
    for judgement in judgements:
        law = judgement.hypothesis
        if judgement.against_none.z < SURE_SIGMAS or law.is_catalogued or law.law not in LAW_WORDS:
            continue
        effect, depends_on = get_effect(law.id), LAW_WORDS[law.law]
        words = f"A part of the error would go if the {effect.label} changed with {depends_on}."
        yield Hint(depends_on, None, effect.block, words)


def list_quantities(problem: Problem) -> dict[str, Array]:
    """What an error may depend on, at the steps of the path (m,): centred but for signs, of unit mean square."""
    data, path = problem.data, problem.data.path
    turning = path["speed"] * np.tan(path["steady"]) / problem.rig.tractor.wheelbase_m
    bounds = zip(data.path_starts[:-1], data.path_starts[1:], strict=True)
    rate = np.concatenate([np.gradient(path["speed"][begin:end], PATH_STEP_S) for begin, end in bounds])
    centred = {
        "speed": np.abs(path["speed"]), "angle": np.abs(path["steady"]), "implement": path["working"],
        "minutes": path["seconds"], "to_east": path["cosine"], "to_north": path["sine"],
        "east": path["east"], "north": path["north"],
    }  # fmt: skip
    signed = {"lateral": path["speed"] * turning, "turning": turning, "accelerating": rate}
    quantities = {name: values - values.mean() for name, values in centred.items()} | signed
    sizes = {name: float(np.sqrt(np.mean(values * values))) for name, values in quantities.items()}
    return {name: values / sizes[name] for name, values in quantities.items() if sizes[name] > 1e-3}


def find_laws(problem: Problem, rest: Fit, quantities: dict[str, Array]) -> list[Hint]:
    """The law that explains most of the rest, if it is large and predicts left-out driving clearly."""
    arrays = {f"hint_{name}": values for name, values in quantities.items()}
    tried = {hypothesis: change for change in CHANGES for hypothesis in _list_laws(change, arrays)}
    before = dict(problem.bases.arrays)
    problem.bases.arrays |= arrays
    try:
        gains = [one for one in problem.scan(rest, tried)
                 if one.nats > ADD_NATS and abs(one.amounts[0]) > one.hypothesis.finest]  # fmt: skip
        searcher = Searcher(problem)
        predicted = searcher.predict(rest) if gains else {}
        for gain in gains[:MOST_TRIED]:
            model = (*rest.model, gain.hypothesis)
            other = searcher.predict(problem.refit(model, np.concatenate([rest.amounts, gain.amounts]), 4))
            better = np.concatenate([(other[channel] - predicted[channel]).ravel() for channel in other])
            if better.sum() > CLEAR_SIGMAS * np.sqrt(np.sum((better - better.mean()) ** 2)):
                change, depends_on = tried[gain.hypothesis], QUANTITY_WORDS[gain.hypothesis.basis.removeprefix("hint_")]
                words = f"The error looks like {change.words} that depends on {depends_on}."
                return [Hint(depends_on, change.instrument, change.block, words)]
        return []
    finally:
        problem.bases.arrays = before


def _list_laws(change: Change, arrays: dict[str, Array]) -> list[Hypothesis]:
    keys = [key for key in (f"hint_{key}" for key in change.keys) if key in arrays]
    own = [(Coordinate(((change.field, 1.0),), change.width, -math.inf, math.inf, key),) for key in keys]
    pairs = zip(keys, own, strict=True)
    return [Hypothesis(f"hint_{change.field}", *pair, PENALTIES["place"], change.least) for pair in pairs]


def list_loud(squares: dict[str, Array], ratios: dict[str, Array]) -> Iterator[Hint]:
    """Instruments and blocks that are louder than noise, by mean squares (w,) of whitened residuals per channel.

    `ratios` are fitted parts of the noise over their limits.
    """
    loud = {channel for channel, own in squares.items() if len(own) and own.mean() > LOUD_SQUARE}
    yield from (hint for channel, hint in LOUD_SENSOR.items() if channel in loud)
    if "pose" in loud:
        pairs = list(zip(POSE_PARTS, ratios["pose"], strict=True))
        of = {name: max(float(ratio) for part, ratio in pairs if part.shown_by == name) for name in LOUD_POSE}
        if min(of["speed"], of["heading"]) > LOUD_RATIO:
            of["position"] = math.inf
        yield LOUD_POSE[max(of, key=lambda name: of[name])]


def list_clues(problem: Problem, squares: dict[str, Array], quantities: dict[str, Array]) -> Iterator[Hint]:
    """Per channel, with what driving the size of its error goes together most."""
    for channel, own in squares.items():
        if len(own) < max(FEWEST_CLUE_WINDOWS, problem.data.windows):
            continue
        cut = {key: problem.data.cut(quantities[key], 1)[:, 0] for key in WHERE_WORDS if key in quantities}
        clues = [(compute_rank_sigmas(values, own), key, compare_thirds(values, own)) for key, values in cut.items()]
        clues = [one for one in clues if one[0] > SURE_SIGMAS and max(one[2], 1.0 / one[2]) >= CLUE_TIMES]
        if clues:
            _, key, times = max(clues)
            instrument, name = CHANNEL_WORDS[channel]
            more, less = WHERE_WORDS[key] if times > 1.0 else WHERE_WORDS[key][::-1]
            size = f"Errors of {name} are {max(times, 1.0 / times):.1f} times as large {more} as {less}"
            yield Hint(QUANTITY_WORDS[key], instrument, None, f"{size}: look for what differs there.")


def compute_rank_sigmas(values: Array, squares: Array) -> float:
    """How many standard deviations the rank correlation of two columns (w,) is from none."""
    if np.ptp(values) == 0.0 or np.ptp(squares) == 0.0:
        return 0.0
    share = float(np.corrcoef(rankdata(values), rankdata(squares))[0, 1])
    return math.atanh(min(abs(share), 0.999)) * math.sqrt(len(values) - 3)


def compare_thirds(values: Array, squares: Array) -> float:
    """How many times as large errors are in the windows with the largest values as in those with the smallest.

    These are thirds of the windows, or those above and below the middle where many share a value.
    """
    low, high = np.quantile(values, 1.0 / 3.0), np.quantile(values, 2.0 / 3.0)
    is_low, is_high = values <= low, values >= high
    if low == high or max(is_low.mean(), is_high.mean()) > 0.5:
        is_high = values > 0.5 * (values.min() + values.max())
        is_low = ~is_high
    if not (is_low.any() and is_high.any()):
        return 1.0
    return math.sqrt(max(float(squares[is_high].mean()), 1e-6) / max(float(squares[is_low].mean()), 1e-6))
