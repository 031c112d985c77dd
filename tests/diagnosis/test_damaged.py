"""Damaged logs of a tractor that is as its file says: each ends in a sentence or without a name."""

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest

from tests.diagnosis.hiding import brief_programme, told
from tests.truth.drives import three_speeds_programme
from tests.truth.model import make_logs
from tests.truth.second import second_logs
from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.errors import LogError
from vehicle.identification.logs.reader import build_log
from vehicle.model.tractor import load_tractor

RUNS = ("straight_090", "circles_right", "steps")
SELDOM = ("speeds exchanged", "a speed that is noise", "a wheel angle that is noise", "every row twice")
"""Damages that are searched for causes longest; a heading that is noise stands for them in every run of CI."""


def _draw(frame: pd.DataFrame) -> np.random.Generator:
    """Draws of a log, the same whichever tests run."""
    return np.random.default_rng([5, len(frame)])


def _holes(frame: pd.DataFrame) -> pd.DataFrame:
    holed, rng = frame.copy(), _draw(frame)
    for name in ("time_s", "easting_m", "heading_deg", "speed_mps", "steering_deg", "steering_command_deg"):
        holed.loc[rng.random(len(frame)) < 0.04, name] = np.nan
    return holed


def _exchanged(one: str, other: str) -> Callable[[pd.DataFrame], pd.DataFrame]:
    return lambda frame: frame.rename(columns={one: other, other: one})


REFUSED: dict[str, Callable[[pd.DataFrame], pd.DataFrame]] = {
    "two rows": lambda frame: frame.iloc[:2],
    "twelve rows": lambda frame: frame.iloc[40:52],
    "the tractor stands": lambda frame: frame.assign(easting_m=5.0, northing_m=7.0),
    "times backwards": lambda frame: frame.assign(time_s=frame.time_s.to_numpy()[::-1]),
    "rows shuffled": lambda frame: frame.sample(frac=1.0, random_state=1),
    "one time": lambda frame: frame.assign(time_s=3.0),
    "east and north exchanged": _exchanged("easting_m", "northing_m"),
    "heading and wheel angle exchanged": _exchanged("heading_deg", "steering_deg"),
    "always in reverse": lambda frame: frame.assign(shuttle=-1),
    "steering exchanged": _exchanged("steering_deg", "steering_command_deg"),
}
NAMELESS: dict[str, Callable[[pd.DataFrame], pd.DataFrame]] = {
    "commands of 0 while wheels turn": lambda frame: frame.assign(steering_command_deg=0.0),
    "one heading": lambda frame: frame.assign(heading_deg=33.0),
    "speeds exchanged": _exchanged("speed_mps", "speed_command_mps"),
    "holes": _holes,
    "every row twice": lambda frame: pd.concat([frame, frame]),
    "a heading that is noise": lambda frame: frame.assign(heading_deg=_draw(frame).uniform(0.0, 360.0, len(frame))),
    "a speed that is noise": lambda frame: frame.assign(speed_mps=_draw(frame).uniform(0.0, 3.0, len(frame))),
    "positions of a receiver of 2 Hz": lambda frame: frame.assign(
        **{name: frame[name].to_numpy()[np.arange(len(frame)) // 5 * 5] for name in ("easting_m", "northing_m")}
    ),
    "a compass in steps of 5 degrees": lambda frame: frame.assign(heading_deg=(frame.heading_deg / 5.0).round() * 5.0),
    "a wheel angle that is noise": lambda frame: frame.assign(steering_deg=_draw(frame).normal(0.0, 8.0, len(frame))),
}


@pytest.fixture(scope="module")
def frames() -> list[pd.DataFrame]:
    drives = [one for one in brief_programme() if one.name in RUNS]
    return make_logs({}, 3, drives, rate_hz=10.0)


@pytest.mark.parametrize("damage", REFUSED)
def test_what_is_no_log_is_refused_in_a_sentence(damage: str, frames: list[pd.DataFrame]) -> None:
    with pytest.raises(LogError) as refused:
        told([REFUSED[damage](one) for one in frames])
    assert "run " in str(refused.value) and str(refused.value).endswith(".")


@pytest.mark.slow
@pytest.mark.parametrize(
    "damage", [pytest.param(one, marks=pytest.mark.matrix if one in SELDOM else ()) for one in NAMELESS]
)
def test_a_damaged_log_earns_no_name(damage: str, frames: list[pd.DataFrame]) -> None:
    assert told([NAMELESS[damage](one) for one in frames]).named == ()


@pytest.mark.slow
@pytest.mark.parametrize(("tractor", "seed"), [pytest.param("eg105", 905, marks=pytest.mark.matrix), ("mr1000a", 906)])
def test_positions_and_commands_alone_earn_no_name(tractor: str, seed: int) -> None:
    logs = [
        build_log(frame[["time_s", "easting_m", "northing_m", "steering_command_deg"]], frame.attrs["name"])
        for frame in second_logs({}, seed, three_speeds_programme()[1:5], tractor)
    ]
    found = diagnose_logs(logs, load_tractor(tractor), "soil")
    assert found.named == () and found.unexplained_share == 0.0
    assert not [one.id for one in found.findings if one.value is not None]


@pytest.mark.parametrize("apart", ["rows", "positions"])
def test_too_few_positions_for_a_piece_are_refused_in_a_sentence(apart: str, frames: list[pd.DataFrame]) -> None:
    held = [np.arange(len(frame)) // 18 * 18 for frame in frames]
    places = ["easting_m", "northing_m"]
    if apart == "rows":
        logs = [frame.iloc[::18] for frame in frames]
    else:
        logs = [
            frame.assign(**{name: frame[name].to_numpy()[rows] for name in places})
            for frame, rows in zip(frames, held, strict=True)
        ]
    with pytest.raises(LogError, match="hold 4 measured positions"):
        told(logs)


@pytest.mark.matrix
def test_logs_of_two_tractors_with_the_file_of_one_earn_no_name(frames: list[pd.DataFrame]) -> None:
    assert told([*frames, *second_logs({}, 3, three_speeds_programme()[:2], "mr1000a")]).named == ()
