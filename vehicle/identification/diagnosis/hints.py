"""The error that a true model would still have in these logs, and hints where more remains and has no name.

The floor: runs are replayed from their commands twice: with the causes of a fit alone, as a tractor file holds them,
and with its nuisances and noise as the fit found it, which is what instruments would have shown. The difference is the
floor. A fit calls noise whatever it has no cause for, so the floor takes of each slow part no more than ground, tyres
and instruments were ever seen to make; what is beyond that is unexplained.

A hint is no cause. It is looked for with noise no larger than that: laws that would explain the rest come first, then
the instrument that is louder than it may be, then where the error is larger.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter
from scipy.stats import rankdata

from fields.arrays import Floats
from vehicle.identification.diagnosis.drive_data import (
    PATH_STEP_S,
    POSE_CELL_S,
    SENSOR_CELL_S,
    STRIDE,
    DriveData,
    build_drive_data,
    thin_evenly,
)
from vehicle.identification.diagnosis.grammar import (
    LAW_WORDS,
    PENALTIES,
    Bases,
    Coordinate,
    Hypothesis,
    split_amounts,
    sum_fields,
)
from vehicle.identification.diagnosis.model_fit import Fit, Problem
from vehicle.identification.diagnosis.noise import COMMAND_JITTER, FREEDOM, POSE_PARTS, SENSOR_PARTS
from vehicle.identification.diagnosis.results import ABOVE_FLOOR_FACTOR, Hint
from vehicle.identification.diagnosis.search import ADD_NATS, Judgement, Searcher
from vehicle.identification.logs.series import turn_path
from vehicle.identification.logs.thresholds import CLEAR_SIGMAS, DOUBT_SIGMAS, FEWEST_LINE_CHORDS, SEED, SURE_SIGMAS
from vehicle.identification.replay.drive_inputs import sample_rows
from vehicle.identification.replay.drive_segments import DriveDataset, DriveSegment, ReplayRig
from vehicle.identification.replay.horizon_errors import (
    ERROR_PIECE_S,
    Pieces,
    compute_relative_error,
    join_pieces,
    measure_pieces,
)
from vehicle.identification.replay.simulation import Simulator
from vehicle.model.effects import PATH, get_effect

MOST_HINTS, MOST_TRIED = 4, 3  # chosen: a longer list is of no use to a reader; laws of a scan that are fitted
# Mean square of whitened residuals with noise that is still noise: eleven clean sets have 1.1, 1.9 with misjudged crab.
LOUD = 1.5  # also the ratio of a part of the noise to its limit, from which it is part of what is too loud
CLUE_TIMES = 2.0  # errors in the third of windows where they are larger over the other: noise shows up to 1.9
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
GROUND_KEYS = ("speed", "implement", "minutes", "to_east", "to_north", "east", "north", "lateral")
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

MOST_PIECES = 400  # of 40 s: more of a long drive make no other floor
DRAWS = 4  # samples of the noise; with four the floor scatters half as much as the error of the logs
Rng = np.random.Generator
Model = Sequence[tuple[Hypothesis, Floats]]
LEAST_SHARE = 0.02  # chosen: smaller shares are printed as 0


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


def find_hints(problem: Problem, fit: Fit, judgements: Sequence[Judgement]) -> tuple[Hint, ...]:
    """Hints on what a fit leaves above the noise; one sentence each, the most telling first. The noise of the problem
    is kept."""
    noise = problem.get_noise()
    hints = list(list_law_hints(judgements))
    try:
        limits = limit_noise(problem)
        problem.set_noise({channel: 2.0 * np.log(sizes) for channel, sizes in limits.items()})
        rest = problem.refit(fit.model, fit.amounts, 2)
        quantities = list_quantities(problem)
        hints += find_laws(problem, rest, quantities)
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


def list_quantities(problem: Problem) -> dict[str, Floats]:
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


def find_laws(problem: Problem, rest: Fit, quantities: dict[str, Floats]) -> list[Hint]:
    """The law that explains most of the rest, if it is large and predicts left-out driving clearly."""
    arrays = {f"hint_{name}": values for name, values in quantities.items()}
    tried = {}
    for change in CHANGES:
        for key in [f"hint_{name}" for name in change.keys if name in quantities]:
            own = (Coordinate(((change.field, 1.0),), change.width, -math.inf, math.inf, key),)
            tried[Hypothesis(f"hint_{change.field}", key, own, PENALTIES["place"], change.least)] = change
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


def list_loud(squares: dict[str, Floats], ratios: dict[str, Floats]) -> Iterator[Hint]:
    """What is louder than noise, by mean squares (w,) of whitened residuals, and ratios of noise to its limits."""
    loud = {channel for channel, own in squares.items() if len(own) and own.mean() > LOUD}
    yield from (hint for channel, hint in LOUD_SENSOR.items() if channel in loud)
    if "pose" in loud:
        pairs = list(zip(POSE_PARTS, ratios["pose"], strict=True))
        of = {name: max(float(ratio) for part, ratio in pairs if part.shown_by == name) for name in LOUD_POSE}
        if min(of["speed"], of["heading"]) > LOUD:
            of["position"] = math.inf
        yield LOUD_POSE[max(of, key=lambda name: of[name])]


def list_clues(problem: Problem, squares: dict[str, Floats], quantities: dict[str, Floats]) -> Iterator[Hint]:
    """Per channel, with what driving the size of its error goes together most."""
    for channel, own in squares.items():
        if len(own) < max(FEWEST_LINE_CHORDS, problem.data.windows):
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


def compute_rank_sigmas(values: Floats, squares: Floats) -> float:
    """How many standard deviations the rank correlation of two columns (w,) is from none."""
    if np.ptp(values) == 0.0 or np.ptp(squares) == 0.0:
        return 0.0
    share = float(np.corrcoef(rankdata(values), rankdata(squares))[0, 1])
    return math.atanh(min(abs(share), 0.999)) * math.sqrt(len(values) - 3)


def compare_thirds(values: Floats, squares: Floats) -> float:
    """How many times as large errors are in the windows of the largest values as in those of the smallest: thirds, or
    halves about the middle where many share a value."""
    low, high = np.quantile(values, 1.0 / 3.0), np.quantile(values, 2.0 / 3.0)
    is_low, is_high = values <= low, values >= high
    if low == high or max(is_low.mean(), is_high.mean()) > 0.5:
        is_high = values > 0.5 * (values.min() + values.max())
        is_low = ~is_high
    if not (is_low.any() and is_high.any()):
        return 1.0
    return math.sqrt(max(float(squares[is_high].mean()), 1e-6) / max(float(squares[is_low].mean()), 1e-6))


# --- the noise floor: what a model without faults would still miss ---


def compute_noise_floor(problem: Problem, fit: Fit, dataset: DriveDataset) -> Pieces:
    """The errors that noise (of the problem as it is now) and nuisances leave where the causes of a fit are true, of
    DRAWS draws; `dataset` may hold more runs, and of a long one pieces are looked at."""
    data = problem.data if dataset is problem.data.dataset else build_drive_data(thin_evenly(dataset, MOST_PIECES))
    model = list(split_amounts(fit.model, fit.amounts))
    expected = replay_commands(data, problem.rig, [part for part in model if not part[0].is_nuisance])[:2]
    antenna, heading, wheel, speed = replay_commands(data, problem.rig, model)
    spread = math.sqrt(FREEDOM / (FREEDOM - 2.0))  # a Student t distribution has a larger variance than its scale
    sizes = {channel: spread * own for channel, own in limit_noise(problem).items()}
    ends, rng = np.cumsum([segment.rows for segment in data.segments]), np.random.default_rng(SEED)
    drawn: list[Pieces] = []
    for number, segment in enumerate(data.segments):
        rows = slice(ends[number] - segment.rows, ends[number])
        motion = _MotionDraw(problem, segment, sizes, *(
            one[data.path_starts[number] : data.path_starts[number + 1]]
            for one in (wheel, speed, data.path["heading"])))  # fmt: skip
        for _ in range(DRAWS):
            noisy = motion.draw(antenna[rows], heading[rows], rng)
            drawn.append(measure_pieces(noisy, *(one[rows] for one in expected)))
    return join_pieces(drawn)


def limit_noise(problem: Problem) -> dict[str, Floats]:
    """Standard deviations of the parts of the noise per channel, none above what is still noise."""
    parts = {"pose": POSE_PARTS, **SENSOR_PARTS}
    most = {channel: np.array([part.most for part in own]) for channel, own in parts.items()}
    most["wheel"][3:] = np.maximum(most["wheel"][3:], DOUBT_SIGMAS * COMMAND_JITTER * problem.data.row_step_s)
    return {channel: np.minimum(np.exp(0.5 * one.amounts), most[channel]) for channel, one in problem.noise.items()}


def replay_commands(data: DriveData, rig: ReplayRig, model: Model) -> tuple[Floats, Floats, Floats, Floats]:
    """Drive the commands of all segments open loop; where none were logged, as wheel and speed were measured.

    Returns the antenna (k, 2, m) and heading (k,) at all rows, one segment after the other, and the wheel angle (rad)
    and speed (m/s) at the steps of the path (m,).
    """
    causes = [one for one, _ in model]
    amounts = np.concatenate([np.zeros(0), *(own for _, own in model)])
    rows = sample_rows(data.segments, data.path_starts, PATH_STEP_S)
    simulator = Simulator(replace(data, east=rows, north=rows, heading=rows), rig)
    fields = sum_fields(causes, amounts, Bases(data), simulator.base)
    wheel, path = simulator.replay(fields)
    shown = simulator.show_pose(path, fields)
    return np.stack([shown["east"], shown["north"]], axis=1), shown["heading"], wheel[::STRIDE], path[3]


class _MotionDraw:
    """The motion of a segment at the steps of its path, and the noise that goes with it."""

    def __init__(
        self, problem: Problem, segment: DriveSegment, sizes: dict[str, Floats], wheel: Floats, speed: Floats,
        heading: Floats,
    ) -> None:  # fmt: skip
        tractor = problem.rig.tractor
        self.segment, self.sizes, self.wheel, self.speed, self.heading = segment, sizes, wheel, speed, heading
        self.places = segment.time / PATH_STEP_S
        self.turning = np.gradient(heading, PATH_STEP_S)
        self.row_step_s = problem.data.row_step_s
        self.curvature = np.tan(wheel) / tractor.wheelbase_m
        self.bend = 1.0 / (np.cos(wheel) ** 2 * tractor.wheelbase_m)
        self.ahead = tractor.antenna_forward_m

    def draw(self, antenna: Floats, heading: Floats, rng: Rng) -> DriveSegment:
        """The segment with positions and headings as they might have been measured."""
        pose, count, forward = self.sizes["pose"], len(self.speed), self.speed

        def remember(number: int) -> Floats:
            return draw_memory(rng, count, POSE_PARTS[number].memory_s)

        yaw = np.sum([pose[number] * remember(number) for number in (4, 5, 6)], axis=0)
        yaw = yaw + pose[7] * np.abs(self.turning) * remember(7)
        follow = self._draw_sensor(rng, "wheel", self.wheel)
        lag = self._draw_sensor(rng, "speed", forward)
        yaw += forward * self.bend * follow + self.curvature * lag
        push = lag + pose[8] * draw_cells(rng, count, POSE_CELL_S) + pose[9] * remember(9)
        crab = forward * pose[10] * remember(10)
        cosine, sine = np.cos(self.heading), np.sin(self.heading)
        # How far the path goes to the east and the north and turns, and for a moment ahead.
        east, north, turned = (
            self._sample(np.cumsum(rate) * PATH_STEP_S)
            for rate in (push * cosine - crab * sine, push * sine + crab * cosine, yaw)
        )
        jitter = self._sample(forward * pose[11] * draw_cells(rng, count, POSE_CELL_S))
        cosine, sine = np.cos(heading), np.sin(heading)
        places = turn_path(antenna, turned)
        places += jitter[:, None] * np.stack([cosine, sine], axis=1)
        places += self.ahead * turned[:, None] * np.stack([-sine, cosine], axis=1)
        # Noise of positions and of headings at the rows; a cell holds the mean of several.
        rows, time = self.segment.rows, self.segment.time
        by_row = np.sqrt(max(POSE_CELL_S / self.row_step_s, 1.0))
        steps = np.sqrt(np.diff(time, prepend=time[0]))[:, None]
        walk = np.cumsum(steps * rng.standard_normal((rows, 2)), axis=0)
        position = by_row * pose[0] * rng.standard_normal((rows, 2)) + pose[2] * walk
        drift = self._sample(remember(3))
        direction = by_row * pose[1] * rng.standard_normal(rows) + pose[3] * drift
        places += np.stack([east, north], axis=1) + position
        if self.segment.heading_measured:
            heading = heading + turned + direction
        return replace(self.segment, east=places[:, 0], north=places[:, 1], heading=heading)

    def _sample(self, steps: Floats) -> Floats:
        return np.interp(self.places, np.arange(len(steps)), steps)

    def _draw_sensor(self, rng: Rng, channel: str, values: Floats) -> Floats:
        """How a wheel angle (rad) or speed (m/s) follows its command otherwise than simulated."""
        segment, sizes, count = self.segment, self.sizes[channel], len(values)
        command, measured = (segment.command, segment.wheel is not None) if channel == "wheel" else (
            segment.target, segment.speed_measured)  # fmt: skip
        if command is None or not measured:
            return np.zeros(count)
        memories_s = [part.memory_s for part in SENSOR_PARTS[channel]]
        late_s = max(memories_s[4], self.row_step_s) if channel == "wheel" else memories_s[4]
        rate = np.gradient(values, PATH_STEP_S)
        slow = sum(sizes[number] * draw_memory(rng, count, memories_s[number]) for number in (1, 2))
        late = sizes[3] * draw_cells(rng, count, SENSOR_CELL_S) + sizes[4] * draw_memory(rng, count, late_s)
        return np.asarray(sizes[0] * draw_cells(rng, count, SENSOR_CELL_S) + slow + rate * late)


def draw_memory(rng: Rng, count: int, time_constant: float) -> Floats:
    """Unit noise (count,) at steps of the path that forgets with a time constant (s)."""
    memory = np.exp(-PATH_STEP_S / time_constant)
    white = np.sqrt(1.0 - memory * memory) * rng.standard_normal(count)
    values, _ = lfilter([1.0], [1.0, -memory], white, zi=[memory * rng.standard_normal()])
    return np.asarray(values)


def draw_cells(rng: Rng, count: int, cell_s: float) -> Floats:
    """Unit noise (count,) at steps of the path, the same within a cell."""
    steps = round(cell_s / PATH_STEP_S)
    return np.repeat(rng.standard_normal(-(-count // steps)), steps)[:count]


def measure_unexplained(
    dataset: DriveDataset, row_step_s: float, floor: Pieces, before: Pieces, after: Pieces
) -> tuple[float, tuple[float, ...]]:
    """The share of the error over 5 s above the noise floor that a model leaves, and the horizons (s) with an error
    above it; `before` is that of the tractor file, `after` that of the model.

    Errors are in units of the floor, and count along the path where all speeds were measured. Those over a horizon are
    noise where they are no more than noise, and motion between rows, would leave by chance. The share is 0 while the
    error over 5 s is noise.
    """

    def compute_error(pieces: Pieces, horizon: float = ERROR_PIECE_S) -> float:
        return compute_relative_error(pieces, floor, len(dataset.names), dataset.has_speed, horizon)

    def compute_limit(horizon: float) -> float:
        factor = max(ABOVE_FLOOR_FACTOR, 1.0 + compute_chance(dataset.seconds, horizon))
        # Between rows motion is not observed: chosen, once more the floor per second.
        return (factor + row_step_s) * compute_error(floor, horizon)

    above = tuple(
        horizon
        for horizon, rows in after.items()
        if len(rows) and not compute_error(after, horizon) < compute_limit(horizon)
    )
    if ERROR_PIECE_S not in above:
        return 0.0, above
    rest, whole = (compute_error(pieces) - compute_error(floor) for pieces in (after, before))
    share = rest / max(rest, whole)
    return share if share > LEAST_SHARE else 0.0, above


def compute_chance(seconds: float, piece_s: float) -> float:
    """How far an error and its floor differ by chance for the pieces of this much driving, as a share: of n squares by
    2 / n, of three errors a piece, and of a floor that is drawn DRAWS times."""
    pieces = max(seconds / piece_s, 1.0)
    return DOUBT_SIGMAS * math.sqrt(2.0 * (1.0 + 1.0 / DRAWS) / (3.0 * pieces))
