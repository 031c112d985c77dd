"""Sets of logs by every reference: what a seed has of them, how their logs are made, and other runs of the same truth.

A set is a case of tests.truth.cases in logs of one of REFERENCES. `demo` are logs of the simulator that is tested,
which flatter it; `real` are logs of vehicles, of which nothing is known; `varied` are cases of the third whose
logs are also written down in other ways; `mixups` are right logs with one column spoiled (tests.diagnosis.mixups).
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd

from tests.diagnosis.drawn_sets import list_combined_effects, list_single_effects, list_special_cases, make_drawn_case
from tests.diagnosis.mixups import MIXUPS, mix_up
from tests.truth.body import Ground
from tests.truth.cases import ColumnClock, Law, TruthCase
from tests.truth.drawing import draw_cases
from tests.truth.drives import default_programme, one_way_programme, reversing, three_speeds_programme
from tests.truth.effects import NEUTRAL
from tests.truth.model import make_logs as make_first_logs
from tests.truth.second import TRACTORS
from tests.truth.second import second_logs as make_second_logs
from tests.truth.third import make_third_logs
from vehicle.identification.diagnosis.demo_logs import HiddenEffect, draw_hidden_effect, simulate_demo_logs
from vehicle.model.effects import CATALOGUE
from vehicle.model.tractor import Tractor, load_tractor

UNSEEN_SEED, UNSEEN_RUNS, VARIED_SEED = 500_000, 5, 7_000_000
DATA = Path(__file__).parent / "data"
REAL_LOGS = tuple((str(DATA / f"{name}.csv"), str(DATA / f"{name}.toml"), "asphalt") for name in ("rav4", "track_car"))
REFERENCES = ("first", "second", "third", "demo", "varied", "mixups", "real")
VARIED_KINDS = ("clean", "effect", "pair", "closed_loop")
MIXED_RUNS = ("straight_090", "circles_right", "steps", "figure_eight", "implement_weave")
CLOCKS = {"position_delay": ("position", "delay_s"), "heading_delay": ("heading", "delay_s"),
          "heading_filter": ("heading", "filter_s")}  # fmt: skip
"""Effects of the demonstration that the truth has as clocks of columns."""
Frames = list[pd.DataFrame]


@dataclass(frozen=True)
class LogSet:
    """One set: the reference that makes its logs, what is hidden, the name or file of the tractor, and the ground.

    `label` tells sets that hide the same: a size, the name of a mix-up, a demonstrated effect, or where real logs lie.
    """

    reference: str
    case: TruthCase
    label: str = ""
    tractor: str = "eg105"
    ground: str = "soil"
    is_varied: bool = False

    @property
    def key(self) -> str:
        """What tells this set from all others."""
        case = self.case
        if self.reference in ("mixups", "real"):
            label = Path(self.label).name if self.reference == "real" else self.label
            return f"{self.reference} {label} {case.seed}"
        parts = [*case.effects, *(f"{law.effect}:{law.kind}" for law in case.laws), *(one.id for one in case.faults)]
        parts += [f"{name}:{','.join(list_clock_fields(clock))}" for name, clock in case.columns.items()]
        hidden, tractor = "+".join([*parts, *case.outside]), "" if self.tractor == "eg105" else self.tractor
        words = [
            "varied" if self.is_varied else "", self.reference, case.kind, hidden or "nothing", self.label, tractor,
        ]  # fmt: skip
        words += [case.programme, f"{case.rate_hz:g} Hz"]
        return " ".join([*filter(None, words), str(case.seed)])

    @property
    def column(self) -> str:
        """Under which of REFERENCES it is counted."""
        return "varied" if self.is_varied else self.reference


def list_clock_fields(clock: ColumnClock) -> list[str]:
    """Fields of a column's clock that are not neutral."""
    return [field.name for field in dataclasses.fields(clock) if getattr(clock, field.name) != field.default]


# --- what a seed has -----------------------------------------------------------------------------------------------


def list_sets(
    reference: str, seed: int, share: Fraction = Fraction(1), real: Sequence[Sequence[str]] = ()
) -> list[LogSet]:
    """The sets of a seed that are in the share, each kind as often as every other over some seeds in a row.

    `real` are further real logs: a folder of CSV files or one, the tractor file and the ground. Raises ValueError for
    an unknown reference.
    """
    if reference not in REFERENCES:
        raise ValueError(f"The reference {reference!r} is unknown; use one of: {', '.join(REFERENCES)}.")
    sets = draw_real(real) if reference == "real" else DRAWS[reference](seed)
    return [
        one
        for number, one in enumerate(sets)
        if (number + seed) * share.numerator % share.denominator < share.numerator
    ]


def draw_first(seed: int) -> list[LogSet]:
    """Single effects, clear and faint, nothing, and special cases."""
    what = list_single_effects(("clear", "third"))
    labels = [f"{size} {place}" for place, (_, size) in enumerate(what)]
    cases = [make_drawn_case(one, seed, label) for one, label in zip(what, labels, strict=True)]
    single = [LogSet("first", case, label) for case, label in zip(cases, labels, strict=True)]
    return [*single, *(LogSet("first", case) for case in list_special_cases(seed))]


def draw_second(seed: int) -> list[LogSet]:
    """Single effects of three sizes, pairs and triples, in tractors that take turns."""
    what, sets = [*list_single_effects(("clear", "half", "third")), *list_combined_effects(seed)], []
    for place, one in enumerate(what):
        tractor = list(TRACTORS)[(place + seed) % len(TRACTORS)]
        label = f"{one[1]} {place}"
        sets.append(LogSet("second", make_drawn_case(one, seed, f"{label} {tractor}"), label, tractor))
    return sets


def draw_third(seed: int) -> list[LogSet]:
    """All cases that the third reference draws, by kind."""
    return [LogSet("third", case) for case in sorted(draw_cases(seed), key=lambda case: case.kind)]


def draw_demo(seed: int) -> list[LogSet]:
    """Every effect that the demonstration can hide, and none."""
    return [
        make_demo_set(name, seed) for name in ("nothing", *(one.id for one in CATALOGUE if not one.is_of_log_alone))
    ]


def make_demo_set(name: str, seed: int) -> LogSet:
    """The set of the demonstration that hides an effect, or nothing."""
    if name == "nothing":
        return LogSet("demo", TruthCase("clean", seed), name)
    ids = frozenset({name})
    case = TruthCase("effect", seed, allowed=ids, wanted=ids)
    values = draw_hidden_effect(seed, load_tractor("eg105"), name).values
    if name in NEUTRAL:
        return LogSet("demo", replace(case, effects={name: values}), name)
    column, key = CLOCKS[name]
    return LogSet("demo", replace(case, columns={column: ColumnClock(**{key: next(iter(values.values()))})}), name)


def draw_varied(seed: int) -> list[LogSet]:
    """Some kinds of the third reference, at a seed of their own."""
    sets = [one for one in draw_third(seed + VARIED_SEED) if one.case.kind in VARIED_KINDS]
    return [replace(one, is_varied=True) for one in sets]


def draw_mixups(seed: int) -> list[LogSet]:
    """Every mix-up once."""
    return [LogSet("mixups", mixup.make_case(seed), name) for name, mixup in MIXUPS.items()]


def draw_real(more: Sequence[Sequence[str]] = ()) -> list[LogSet]:
    """The logs of vehicles at hand."""
    return [LogSet("real", TruthCase("mixed", 0), one[0], one[1], one[2]) for one in (*REAL_LOGS, *more)]


DRAWS: dict[str, Callable[[int], list[LogSet]]] = {
    "first": draw_first, "second": draw_second, "third": draw_third, "demo": draw_demo, "varied": draw_varied,
    "mixups": draw_mixups,
}  # fmt: skip


# --- logs ----------------------------------------------------------------------------------------------------------


def load_set_tractor(one: LogSet) -> Tractor:
    """The tractor file that a set is diagnosed with."""
    return load_tractor(Path(one.tractor) if one.tractor.endswith(".toml") else one.tractor)


def make_frames(one: LogSet) -> Frames:
    """The logs of a set."""
    case = one.case
    if one.reference == "third":
        return make_third_logs(case)
    if one.reference == "mixups":
        return [mix_up(one.label, frame) for frame in make_right_frames(case.seed)]
    if one.reference == "demo":
        return make_demo_frames(one)
    if one.reference == "real":
        return split_real_frames(one.label)[0]
    if one.reference == "first":
        return make_first_frames(case)
    drives = [drive.mirrored() if is_mirrored(case) else drive for drive in three_speeds_programme()]
    effects = {name: dict(values) for name, values in case.effects.items()}
    return make_second_logs(effects, case.seed, drives, one.tractor)


def is_mirrored(case: TruthCase) -> bool:
    """Whether drives are mirrored, as those of every other pair of seeds are."""
    return case.seed // 2 % 2 == 1


def make_first_frames(case: TruthCase) -> Frames:
    """Logs of the first reference; those of an uneven programme are far from the origin and have gaps."""
    programmes = {"three_speeds": three_speeds_programme, "one_way": one_way_programme}
    drives = programmes.get(case.programme, default_programme)()
    drives = [drive.mirrored() if is_mirrored(case) else drive for drive in drives]
    uneven: dict[str, object] = {"origin": (536000.0, 4769000.0), "uneven": 0.5, "gaps": 1}
    conditions = uneven if case.programme == "uneven" else {}
    return make_first_logs({**case.effects, **case.outside}, case.seed, drives, rate_hz=case.rate_hz, **conditions)


def make_unseen_case(case: TruthCase, seed: int) -> TruthCase:
    """The same truth with other draws of ground, noise and drives; what befell single runs is left out."""
    laws = tuple(
        Law(law.effect, "constant", {"value": law.values["other"]}) if law.kind == "by_run" else law
        for law in case.laws
    )
    return replace(case, seed=seed, laws=laws, faults=())


def make_unseen_frames(one: LogSet) -> Frames:
    """Logs of the same truth with no part in the set; none for mix-ups."""
    if one.reference == "real":
        return split_real_frames(one.label)[1]
    if one.reference == "mixups":
        return []
    return make_frames(replace(one, case=make_unseen_case(one.case, one.case.seed + UNSEEN_SEED)))[:UNSEEN_RUNS]


def make_demo_frames(one: LogSet) -> Frames:
    """Logs of the demonstration as tables."""
    tractor, case = load_tractor("eg105"), one.case
    values = case.effects.get(one.label)
    if values is None and one.label != "nothing":
        column, key = CLOCKS[one.label]
        values = {draw_key(one.label): getattr(case.columns[column], key)}
    hidden = None if values is None else HiddenEffect(one.label, dict(values))
    frames = []
    for log in simulate_demo_logs(hidden, tractor, one.ground, case.seed, case.rate_hz):
        columns = ("time_s", "easting_m", "northing_m", "heading_deg", "speed_mps", "speed_command_mps",
                   "steering_command_deg", "steering_deg", "implement")  # fmt: skip
        frame = pd.DataFrame({name: getattr(log, name) for name in columns})
        frame.attrs["name"] = log.name
        frames.append(frame)
    return frames


def draw_key(name: str) -> str:
    """The key of the value of an effect of one number."""
    return next(iter(draw_hidden_effect(0, load_tractor("eg105"), name).values))


def split_real_frames(path: str) -> tuple[Frames, Frames]:
    """Real logs and unseen ones: every fourth file of a folder, or the last third of the only one.

    Raises ValueError for a folder without logs.
    """
    files = sorted(Path(path).glob("*.csv")) if Path(path).is_dir() else [Path(path)]
    if not files:
        raise ValueError(f"There is no log in {path}; give a folder of CSV files in the columns of the guide.")
    frames = []
    for file in files:
        frame = pd.read_csv(file)
        frame.attrs["name"] = file.stem
        frames.append(frame)
    if len(frames) > 1:
        return [one for place, one in enumerate(frames) if place % 4 != 3], frames[3::4]
    (whole,) = frames
    parts = [whole.iloc[rows].reset_index(drop=True) for rows in np.split(np.arange(len(whole)), [2 * len(whole) // 3])]
    for part in parts:
        part.attrs["name"] = whole.attrs["name"]
    return [parts[0]], [parts[1]]


@lru_cache(maxsize=2)
def make_right_frames(seed: int) -> tuple[pd.DataFrame, ...]:
    """The logs that mix-ups spoil: all columns, forward and reverse, on hills, with nothing hidden."""
    drives = [drive for drive in default_programme() if drive.name in MIXED_RUNS]
    ground = Ground(wave_m=0.6, length_m=45.0, drift=0.0)
    return tuple(make_first_logs({}, seed, [*drives, reversing()], rate_hz=10.0, ground=ground))
