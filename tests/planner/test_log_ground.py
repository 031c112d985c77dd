"""The ground under logs, from a file of heights and from heights of their own: what it explains, and when it cannot."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fields.geometry.geodesy import project
from planner import HeadlandError, diagnose, replay
from planner.errors import RequestError
from planner.pipeline.log_ground import HeightFile, add_known_ground, describe_known_ground
from tests.diagnosis.hiding import brief_programme
from tests.drawn_fields import write_heights
from tests.reports.test_diagnosis import diagnosis, finding
from tests.truth.body import Ground, falls
from tests.truth.model import make_logs
from vehicle.identification.diagnosis.results import NAMED
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.readings import LogConvention, convert_columns
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.terrain import estimate_cross_slope, estimate_grade_speed
from vehicle.identification.replay.drive_segments import build_dataset
from vehicle.model.effect_kinds import PER_SLOPE
from vehicle.model.effects import BY_ROLL, SLOPE_DRIFT, get_effect

pytestmark = pytest.mark.usefixtures("first_layout")

HILLS = Ground(fall_east=0.05, wave_m=0.6, length_m=45.0, drift=0.4, climb=0.8)
SENSORS = ["roll_deg", "pitch_deg"]


def compute_height(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    """The height whose fall is that of HILLS."""
    turn = 2.0 * math.pi / HILLS.length_m
    waves = HILLS.wave_m * np.cos(turn * east) * np.sin(0.7 * turn * north + 1.0)
    return 100.0 - HILLS.fall_east * east + waves


@pytest.fixture(scope="module")
def frames() -> list[pd.DataFrame]:
    """Seven runs on hills that fall to the east, without roll and pitch."""
    made = make_logs({}, 4, brief_programme(), rate_hz=10.0, ground=HILLS)
    return [frame.drop(columns=SENSORS) for frame in made]


def read(frames: Sequence[pd.DataFrame]) -> list[Log]:
    return [build_log(frame, f"run {number}") for number, frame in enumerate(frames)]


def add_heights(frames: Sequence[pd.DataFrame], noise_m: float, sign: float = 1.0) -> list[pd.DataFrame]:
    """The runs with heights of their antenna, each from a reference of its own."""
    rng = np.random.default_rng(7)
    return [
        frame.assign(
            elevation_m=sign * compute_height(frame.easting_m, frame.northing_m)
            + 0.1 * number
            + noise_m * rng.standard_normal(len(frame))
        )
        for number, frame in enumerate(frames)
    ]


def list_told(logs: Sequence[Log]) -> tuple[str, str]:
    """What is said of drift and of speed."""
    (across,), (along,) = estimate_cross_slope(logs).remarks, estimate_grade_speed(logs)[1]
    return across, along


def read_number(sentence: str, after: str) -> float:
    return float(sentence.split(after)[1].split()[0])


def test_a_raster_gives_the_fall_under_every_row(frames: list[pd.DataFrame], tmp_path: Path) -> None:
    raster = write_heights(tmp_path / "dem.asc", compute_height, -150.0, 150.0)
    for log in add_known_ground(read(frames), HeightFile(raster)):
        true = [[falls(*place, turn, HILLS)[1] for turn in (0.5 * math.pi, 0.0)]
                for place in zip(log.easting_m, log.northing_m, strict=True)]  # fmt: skip
        assert log.ground_fall == pytest.approx(np.array(true), abs=0.004)  # of 0.13 at most


def test_heights_explain_drift_and_speed_and_what_they_leave_is_said(
    frames: list[pd.DataFrame], tmp_path: Path
) -> None:
    raster = write_heights(tmp_path / "dem.asc", compute_height, -150.0, 150.0)
    logs = add_known_ground(read(frames), HeightFile(raster))
    across, along = list_told(logs)
    assert across.startswith("The heights of dem.asc give the slope across the direction of travel, 5.")
    assert read_number(across, "the tractor drifts ") == pytest.approx(10.0 * HILLS.drift, rel=0.1)
    assert read_number(across, "this leaves ") < 0.7 * read_number(across, " of the ")
    assert read_number(along, "the tractor drives ") == pytest.approx(10.0 * HILLS.climb, rel=0.03)
    assert read_number(along, "differ from them by ") < 0.2 * read_number(along, "instead of ")
    dataset = build_dataset(logs)
    assert dataset.cross_slope.across and dataset.remarks == (across, along)
    fall, bearing, _ = dataset.cross_slope.mean_plane
    assert fall == pytest.approx(HILLS.fall_east, abs=0.02) and bearing == pytest.approx(90.0, abs=15.0)


def test_heights_of_a_file_take_the_place_of_sensors(frames: list[pd.DataFrame], tmp_path: Path) -> None:
    raster = write_heights(tmp_path / "dem.asc", compute_height, -150.0, 150.0)
    logs = add_known_ground(read([frame.assign(roll_deg=1.0) for frame in frames]), HeightFile(raster))
    assert all(log.roll_deg is None for log in logs)
    assert logs[0].set_remarks == ("The heights of dem.asc are used instead of roll_deg.",)


@pytest.mark.slow
@pytest.mark.parametrize("noise_m", [0.0, 0.03])
def test_logs_with_heights_of_their_own_need_no_file(frames: list[pd.DataFrame], noise_m: float) -> None:
    logs = add_known_ground(read(add_heights(frames, noise_m)))
    across, along = list_told(logs)
    assert (
        "The heights of the logs (elevation_m) give the slope" in across and "smoothed over" in logs[0].set_remarks[0]
    )
    assert read_number(across, "the tractor drifts ") == pytest.approx(10.0 * HILLS.drift, rel=0.1)
    assert read_number(along, "the tractor drives ") == pytest.approx(10.0 * HILLS.climb, rel=0.1)


@pytest.mark.slow
def test_roll_is_used_before_heights_of_the_logs(frames: list[pd.DataFrame]) -> None:
    logs = add_known_ground(read([frame.assign(roll_deg=0.0) for frame in add_heights(frames, 0.0)]))
    across, along = list_told(logs)
    assert across.startswith("roll_deg is not used") and "(elevation_m) explain speed" in along


def test_without_heights_nothing_changes(frames: list[pd.DataFrame]) -> None:
    logs = read(frames)
    assert all(one is other for one, other in zip(add_known_ground(logs), logs, strict=True))
    full = [replace(log, roll_deg=log.time_s, pitch_deg=log.time_s) for log in read(add_heights(frames, 0.0))]
    assert all(one is other for one, other in zip(add_known_ground(full), full, strict=True))
    told = diagnosis()
    assert describe_known_ground(told, logs) is told


def test_heights_that_say_nothing_are_not_used(frames: list[pd.DataFrame]) -> None:
    def tell(logs: list[Log]) -> str:
        known = add_known_ground(logs)
        assert all(log.ground_fall is None for log in known) and estimate_cross_slope(known).remarks == ()
        return known[0].set_remarks[0]

    rng = np.random.default_rng(1)
    noise = [frame.assign(elevation_m=50.0 + 0.05 * rng.standard_normal(len(frame))) for frame in frames]
    assert tell(read(noise)).endswith("are not used: they show no slope above their noise.")
    some = [*read(frames[:-1]), *read(add_heights(frames[-1:], 0.0))]
    assert tell(some).endswith("are not used: 1 of 7 logs have them.")
    time = np.arange(0.0, 60.0, 0.1)
    line = pd.DataFrame({"time_s": time, "easting_m": 1.5 * time, "northing_m": 0.0 * time, "heading_deg": 90.0,
                         "steering_deg": 0.0, "elevation_m": 50.0 + 0.05 * time})  # fmt: skip
    assert "single" in tell(read([line]))


def test_heights_of_another_place_are_told_by_a_drift_uphill(frames: list[pd.DataFrame]) -> None:
    across, along = list_told(add_known_ground(read(add_heights(frames, 0.0, sign=-1.0))))
    assert "the tractor drifts uphill on them, and no tractor does" in across and "The ground is taken" in across
    assert "the tractor is faster where they say uphill" in along


def test_the_metres_of_logs_in_degrees_have_a_system(frames: list[pd.DataFrame]) -> None:
    """Places 300 m from the origin in that system are those of the log to a centimetre."""
    from planner.pipeline.log_ground import _find_crs

    degrees = {"easting_m": 9.5 + np.linspace(0.0, 4e-3, 600), "northing_m": 48.7 - np.linspace(0.0, 2.7e-3, 600)}
    time = np.arange(600) * 0.1
    frame = pd.DataFrame({"time_s": time, **degrees, "steering_deg": 0.0})
    (log,) = [build_log(frame, "run", ["position-degrees"], check=False)]
    assert log.origin_deg == (9.5, 48.7)
    crs, _ = _find_crs([log], HeightFile("dem.tif"))
    places = project(np.column_stack(list(degrees.values())), "EPSG:4326", str(crs))
    own = convert_columns({k: np.asarray(v) for k, v in degrees.items()}, frozenset([LogConvention.POSITION_DEGREES]))
    assert places == pytest.approx(np.column_stack([own["easting_m"], own["northing_m"]]), abs=0.03)
    with pytest.raises(RequestError, match="positions of the logs are in degrees, so they need no crs"):
        _find_crs([log], HeightFile("dem.tif", crs="EPSG:32632"))


@pytest.mark.parametrize(("systems", "sentence"), [
    ({"elevation_crs": "EPSG:4326"}, "easting_m and northing_m of the logs do not say their coordinate system"),
    ({"crs": "EPSG:4326", "elevation_crs": "EPSG:32632"}, "crs EPSG:4326 is in degrees"),
    ({"crs": "EPSG:32632"}, "does not name its coordinate system; name it with elevation_crs"),
    ({"crs": "EPSG:32632", "elevation_crs": "EPSG:32654"}, "field 'logs'"),
])  # fmt: skip
def test_systems_that_do_not_fit_are_refused(
    frames: list[pd.DataFrame], tmp_path: Path, systems: dict[str, str], sentence: str
) -> None:
    raster = write_heights(tmp_path / "dem.asc", compute_height, -150.0, 150.0, 10.0)
    with pytest.raises(HeadlandError, match=sentence) as caught:
        add_known_ground(read(frames[:1]), HeightFile(raster, **systems))
    assert "\n" not in str(caught.value)


def test_the_system_of_the_heights_is_that_of_the_logs_and_said(frames: list[pd.DataFrame], tmp_path: Path) -> None:
    raster = write_heights(tmp_path / "dem.asc", compute_height, -150.0, 150.0, 5.0)
    logs = add_known_ground(read(frames[:1]), HeightFile(raster, elevation_crs="EPSG:32632"))
    assert logs[0].set_remarks[0].endswith("in the coordinate system of dem.asc, EPSG:32632.")


def test_what_tyres_leave_of_the_drift_is_said(frames: list[pd.DataFrame], tmp_path: Path) -> None:
    """Side friction of the rear tyres is 0.2 of the load per degree: on 10 % they slip by half a degree, 0.87 cm/m."""
    values = {"ratio": 0.02, "bearing_deg": 90.0, PER_SLOPE: 0.4}
    words = get_effect(SLOPE_DRIFT).describe(values)
    assert BY_ROLL in words
    found = diagnosis(finding("cross_slope_drift", NAMED, value=values, description=words))
    raster = write_heights(tmp_path / "dem.asc", compute_height, -150.0, 150.0, 10.0)
    told = describe_known_ground(found, add_known_ground(read(frames[:1]), HeightFile(raster)))
    (drift,) = [each for each in told.findings if each.id == SLOPE_DRIFT]
    assert drift.description.endswith("across a slope of 10 %, as the heights have the slope.")
    assert told.notes == (
        "Of the drift of 4.0 cm per metre across a slope of 10 % the tyres of the simulation give 0.9 cm where a plan "
        "has heights; 3.1 cm are left to the effect.",
    )


@pytest.mark.matrix
def test_drift_is_named_per_slope_of_the_heights(frames: list[pd.DataFrame], tmp_path: Path) -> None:
    raster = write_heights(tmp_path / "dem.asc", compute_height, -150.0, 150.0)
    found = diagnose(read(frames), heights=raster)
    (drift,) = [each for each in found.findings if each.id == SLOPE_DRIFT]
    assert found.named == (SLOPE_DRIFT,) and found.unexplained_share < 0.05
    assert drift.value[PER_SLOPE] == pytest.approx(HILLS.drift, rel=0.1)
    assert "as the heights have the slope" in found.headline


def test_a_replay_takes_heights_as_a_diagnosis_does(frames: list[pd.DataFrame], tmp_path: Path) -> None:
    raster = write_heights(tmp_path / "dem.asc", compute_height, -150.0, 150.0)
    log = read(frames)[0]
    bare, known = replay(log), replay(log, heights=raster)
    assert known.replayed.errors[5.0].along_cm < 0.5 * bare.replayed.errors[5.0].along_cm, "speeds uphill are explained"
    assert not any("dem.asc" in remark for remark in bare.remarks)
    assert any(remark.startswith("The heights of dem.asc give the slope") for remark in known.remarks)
