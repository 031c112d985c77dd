"""Real vehicles: what the diagnosis says of their logs beside regressions that share no code (`data/SOURCES.md`).

The RAV4 drives a nearly straight motorway: its front wheels move within half a degree. By the regressions its path is
0.8 % longer than its speed adds up to, and its camera points 0.9 degrees to the left of its course.

The track car of about 1:10 turns hard all the time. By the regressions the point whose positions are logged is 3.5 cm
to the left of its middle (in another run of this car, not used here, 3.7 cm), its path is 3.6 % shorter than its speed
adds up to, its headings are 0.9 degrees to the left, and it turns 0.08 s after its commands.
"""

import math
import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from vehicle.errors import VehicleError
from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.diagnosis.results import Diagnosis
from vehicle.identification.logs.reader import read_logs
from vehicle.model.tractor import load_tractor

pytestmark = pytest.mark.slow

DATA = Path(__file__).parent / "data"
LOG, TRACK_LOG = DATA / "rav4.csv", DATA / "track_car.csv"
CAR_LOGS = os.environ.get("HEADLAND_CAR_LOGS", "")
LARGEST_FAILING = {"speed_scale": 0.036, "heading_bias": 0.9, "steering_dead_time": 0.08}  # by the regressions
Columns = dict[str, NDArray[np.float64]]


def load_columns(path: Path) -> Columns:
    names = path.read_text(encoding="utf-8").split("\n", 1)[0].split(",")
    return dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))


@pytest.fixture(scope="module")
def columns() -> Columns:
    return load_columns(LOG)


@pytest.fixture(scope="module")
def track_columns() -> Columns:
    return load_columns(TRACK_LOG)


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    car = load_tractor(DATA / "rav4.toml")
    return diagnose_logs(read_logs([LOG], wheelbase_m=car.wheelbase_m), car, "asphalt")


@pytest.fixture(scope="module")
def track_found() -> Diagnosis:
    car = load_tractor(DATA / "track_car.toml")
    return diagnose_logs(read_logs([TRACK_LOG], wheelbase_m=car.wheelbase_m), car, "asphalt")


def compute_path_ratio(columns: Columns) -> float:
    """Length of the path per integral of the measured speed."""
    steps = np.hypot(np.diff(columns["easting_m"]), np.diff(columns["northing_m"]))
    speed = columns["speed_mps"]
    return float(steps.sum() / np.sum((speed[1:] + speed[:-1]) / 2.0 * np.diff(columns["time_s"])))


def fit_way_ahead(columns: Columns, rows: int = 4) -> tuple[float, float]:
    """Return how far it drives per measured speed, and by how much less per rad that it turns right (m).

    A point to the right of the middle moves less far in a turn to the right. Steps of 0.2 s; those in which positions
    jump are left out.
    """
    heading, speed = np.unwrap(np.radians(columns["heading_deg"])), columns["speed_mps"]
    east, north = (columns[name][rows:] - columns[name][:-rows] for name in ("easting_m", "northing_m"))
    middle, turn = (heading[rows:] + heading[:-rows]) / 2.0, heading[rows:] - heading[:-rows]
    added = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2.0 * np.diff(columns["time_s"]))])
    ahead, expected = east * np.sin(middle) + north * np.cos(middle), added[rows:] - added[:-rows]
    table, used = np.array([expected, -turn]).T, expected > 0.06
    for _ in range(2):
        values = np.linalg.lstsq(table[used], ahead[used], rcond=None)[0]
        missed = np.abs(ahead - table @ values)
        used &= missed < 6.0 * np.median(missed[used])
    return float(values[0]), float(values[1])


def fit_delay_s(columns: Columns) -> float:
    """Return by how much later the heading turns than commands and speed say, where they agree best."""
    time, speed = columns["time_s"], columns["speed_mps"]
    rate, moving = np.gradient(np.unwrap(np.radians(columns["heading_deg"])), time), speed > 0.5
    delays = np.arange(0.0, 0.3, 0.01)
    commands = [np.interp(time - delay, time, columns["steering_command_deg"]) * speed for delay in delays]
    return float(delays[np.argmax([np.corrcoef(command[moving], rate[moving])[0, 1] for command in commands])])


def test_wheels_that_hardly_move_name_no_cause(columns: Columns, found: Diagnosis) -> None:
    assert np.ptp(columns["steering_deg"]) < 0.5
    assert found.named == ()


@pytest.mark.parametrize("vehicle", ["found", "track_found"])
def test_what_may_be_saved_raises_no_error(vehicle: str, request: pytest.FixtureRequest) -> None:
    diagnosis: Diagnosis = request.getfixturevalue(vehicle)
    assert diagnosis.is_savable
    for horizon, before in diagnosis.before.items():
        after = diagnosis.after[horizon]
        assert math.hypot(after.cross_cm, after.along_cm) <= math.hypot(before.cross_cm, before.along_cm), horizon


def test_the_path_is_longer_than_the_speed_says(columns: Columns, found: Diagnosis) -> None:
    assert compute_path_ratio(columns) == pytest.approx(1.008, abs=0.001)
    assert found.after[5.0].along_cm < 0.5 * found.before[5.0].along_cm


def test_the_heading_error_goes_without_a_name_for_it(columns: Columns, found: Diagnosis) -> None:
    """A bias of the heading and a side push look alike on one straight road: the error goes, the cause stays open."""
    east, north = (columns[name][20:] - columns[name][:-20] for name in ("easting_m", "northing_m"))
    course = np.degrees(np.arctan2(east, north))
    bias = float(np.median((columns["heading_deg"][10:-10] - course + 180.0) % 360.0 - 180.0))
    assert bias == pytest.approx(-0.9, abs=0.1)
    assert found.before[1.0].heading_deg == pytest.approx(abs(bias), abs=0.1)
    assert found.after[1.0].heading_deg < 0.5 * found.before[1.0].heading_deg


def test_the_antenna_is_as_far_to_the_side_as_the_regression_says(
    track_columns: Columns, track_found: Diagnosis
) -> None:
    _, right_m = fit_way_ahead(track_columns)
    assert right_m == pytest.approx(-0.035, abs=0.004)
    finding = next(finding for finding in track_found.findings if finding.id == "antenna_right")
    assert finding.status in ("named", "likely") and finding.value is not None and finding.interval is not None
    low, high = finding.interval["distance_m"]
    assert low < right_m < high < 0.0
    assert finding.value["distance_m"] == pytest.approx(right_m, abs=0.01)


def test_what_the_regressions_find_is_neither_refuted_nor_named_otherwise(
    track_columns: Columns, track_found: Diagnosis
) -> None:
    """The diagnosis would have shown somewhat more than these regressions find, and claims no more than that."""
    ratio, _ = fit_way_ahead(track_columns)
    assert ratio == pytest.approx(1.0 - LARGEST_FAILING["speed_scale"], abs=0.004)
    assert fit_delay_s(track_columns) == pytest.approx(LARGEST_FAILING["steering_dead_time"], abs=0.02)
    assert track_found.named == ()
    for finding in track_found.findings:
        is_of_path = finding.id in ("speed_scale", "heading_bias")
        if is_of_path and finding.value is None and finding.smallest_visible is not None:
            assert finding.smallest_visible > LARGEST_FAILING[finding.id], finding.id


def test_a_tractor_file_of_no_vehicle_is_refused_in_one_sentence() -> None:
    """A car half a metre long on axles 6 cm apart, whose simulation spins faster and faster."""
    file = load_tractor(DATA / "track_car.toml")
    car = file.model_copy(update={"front_axle_m": 0.029, "rear_axle_m": 0.033})
    with pytest.raises(VehicleError, match="track car spins"):
        diagnose_logs(read_logs([TRACK_LOG], wheelbase_m=car.wheelbase_m), car, "asphalt")


@pytest.mark.skipif(not CAR_LOGS, reason="HEADLAND_CAR_LOGS does not name the folder of the logs of a 1:10 car")
def test_the_error_is_halved() -> None:
    car = load_tractor(DATA / "dart.toml")
    files = sorted(str(path) for path in Path(CAR_LOGS).glob("*.csv"))
    found = diagnose_logs(read_logs(files, wheelbase_m=car.wheelbase_m), car, "asphalt")
    for kind in ("cross_cm", "along_cm", "heading_deg"):
        assert getattr(found.after[1.0], kind) < 0.5 * getattr(found.before[1.0], kind)
    assert found.named == ("side_slip",)
