"""Point Shapefiles, AgOpenGPS paths and CSV files: the drive that is known comes back from each."""

import json
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
import shapely
from pyogrio.raw import write

from planner.task_logs.log_import import read_task_logs
from planner.task_logs.runs.phases import summarise_run
from planner.task_logs.runs.run_records import project_run
from tests.fields.farm_files import agopengps
from tests.works.conftest import TRACKS, WIDTH_M, WORK_MPS, drive, lonlat
from vehicle.identification.errors import LogError

START = datetime(2017, 11, 29, 16, 21, 32)
MAPPING = (
    '[columns]\ntime = "Zeitpunkt"\nlongitude = "Lon"\nlatitude = "Lat"\nspeed_kmh = "Tempo"\nworks = "Arbeit"\n'
    '[values]\nwidth_m = 6.0\nfield = "Lange Wiese"\n'
)


def write_points(folder: Path, encoding: str = "UTF-8", most: int = 1_000, **columns: np.ndarray) -> Path:
    """A Shapefile as the Operations Center exports it: the drive without its turns, as machines log it."""
    time_s, xy, works = drive()
    rows = np.flatnonzero(works)[:most]
    stamps = [f"{START + timedelta(seconds=float(t)):%Y-%m-%dT%H:%M:%S}.193Z" for t in time_s[rows]]
    table: dict[str, np.ndarray] = {
        "Heading": np.zeros(len(rows)),
        "SWATHWIDTH": np.full(len(rows), WIDTH_M / 0.3048),
        "AppliedRat": np.where(xy[rows, 1] < 90.0, 10.0, 0.0),
        "IsoTime": np.array(stamps, dtype=object),
        **columns,
    }
    points = shapely.to_wkb(shapely.points(lonlat(xy[rows])))
    write(
        str(folder / "points.shp"), points, list(table.values()), list(table), geometry_type="Point", crs="EPSG:4326",
        driver="ESRI Shapefile", encoding=encoding,
    )  # fmt: skip
    return folder / "points.shp"


def test_points_of_a_shapefile(tmp_path: Path) -> None:
    (run,) = read_task_logs(str(write_points(tmp_path))).runs
    time_s, xy, works = drive()
    rows = np.flatnonzero(works)
    assert run.start == "2017-11-29T16:21:32" and run.width_m == pytest.approx(WIDTH_M)
    np.testing.assert_allclose(run.time_s, time_s[rows])
    np.testing.assert_allclose(run.lonlat, lonlat(xy[rows]), atol=1e-9)
    assert run.is_working is not None
    np.testing.assert_array_equal(run.is_working, xy[rows, 1] < 90.0)
    assert any("appliedrat" in note for note in run.notes)
    assert project_run(run).has_logged_speed is False


def test_the_metadata_say_the_field_and_the_unit_of_the_width(tmp_path: Path) -> None:
    path = write_points(tmp_path)
    told = {"FieldName": "Jen-3", "DataAttributes": [{"Name": "SWATHWIDTH", "Unit": "m"}]}
    (tmp_path / "points-Deere-Metadata.json").write_text(json.dumps(told))
    (run,) = read_task_logs(str(path)).runs
    assert run.field == "Jen-3" and run.width_m == pytest.approx(WIDTH_M / 0.3048)
    (tmp_path / "points-Deere-Metadata.json").write_text("[")
    assert read_task_logs(str(path)).runs[0].width_m == pytest.approx(WIDTH_M)


@pytest.mark.parametrize(("unit", "width_m", "words"), [("", WIDTH_M, "in feet"), ("yd", None, "'yd' is unknown")])
def test_a_width_without_its_unit_is_told(tmp_path: Path, unit: str, width_m: float | None, words: str) -> None:
    path = write_points(tmp_path)
    told = {"DataAttributes": [{"Name": "SWATHWIDTH", "Unit": unit}]}
    (tmp_path / "points-Deere-Metadata.json").write_text(json.dumps(told))
    (run,) = read_task_logs(str(path)).runs
    assert run.width_m == (None if width_m is None else pytest.approx(width_m))
    assert any(words in note for note in run.notes)


@pytest.mark.parametrize(("unit", "unit_m"), [("ft", 0.3048), ("m", 1.0), ("", None)])
def test_heights_of_a_shapefile_need_their_unit(tmp_path: Path, unit: str, unit_m: float | None) -> None:
    path = write_points(tmp_path, Elevation=np.linspace(690.0, 700.0, int(drive()[2].sum())))
    told = {"DataAttributes": [{"Name": "Elevation", "Unit": unit}]}
    (tmp_path / "points-Deere-Metadata.json").write_text(json.dumps(told))
    (run,) = read_task_logs(str(path)).runs
    if unit_m is None:
        assert run.elevation_m is None and any("Elevation are not used" in note for note in run.notes)
    else:
        assert run.elevation_m is not None
        np.testing.assert_allclose(run.elevation_m[[0, -1]], [690.0 * unit_m, 700.0 * unit_m])


def test_a_shapefile_without_time_or_without_points_is_told(tmp_path: Path) -> None:
    write(
        str(tmp_path / "a.shp"), shapely.to_wkb(shapely.points([[15.0, 48.0]])), [np.array([1.0])], ["Rate"],
        geometry_type="Point", crs="EPSG:4326", driver="ESRI Shapefile",
    )  # fmt: skip
    with pytest.raises(LogError, match="no column IsoTime or Time"):
        read_task_logs(str(tmp_path / "a.shp"))


def test_names_in_another_encoding_are_read_and_told(tmp_path: Path) -> None:
    _, _, works = drive()
    names = np.array(["Grüner Weg"] * int(works.sum()), dtype=object)
    path = write_points(tmp_path, encoding="ISO-8859-1", Product=names)
    path.with_suffix(".cpg").write_text("UTF-8")
    (run,) = read_task_logs(str(path)).runs
    assert any("Latin-1" in note for note in run.notes)


@pytest.mark.parametrize(("undated", "day"), [(0, ""), (60, "1970-01-01"), (60, "1980-01-06")])
def test_rows_over_a_season_have_a_time_and_those_of_an_epoch_have_none(tmp_path: Path, undated: int, day: str) -> None:
    stamps = [f"{day}T00:{row % 60:02}:00" for row in range(undated)]
    stamps += [f"{START + timedelta(days=row):%Y-%m-%dT%H:%M:%S}" for row in range(90 - undated)]
    places = lonlat(np.column_stack([np.arange(90.0), np.zeros(90)]))
    lines = [f"{stamp},{lon:.8f},{lat:.8f}" for stamp, (lon, lat) in zip(stamps, places, strict=True)]
    (tmp_path / "run.csv").write_text("\n".join(["time,longitude,latitude", *lines]))
    (run,) = read_task_logs(str(tmp_path / "run.csv")).runs
    skipped = [f"{undated} rows whose day the receiver did not know skipped"] if undated else []
    assert len(run.time_s) == 90 - undated and [note for note in run.notes if "skipped" in note] == skipped
    assert run.start == START.isoformat()


@pytest.mark.parametrize("comma", [False, True])
def test_a_recorded_path_of_agopengps(tmp_path: Path, comma: bool) -> None:
    folder = agopengps(tmp_path, comma)
    _, xy, works = drive()
    steps = np.concatenate([np.hypot(*np.diff(xy, axis=0).T), [0.0]])
    lines = ["$RecPath", str(len(xy))]
    for (east, north), speed, at_work in zip(xy, 3.6 * steps, works, strict=True):
        cells = ",".join(f"{value:.3f}".replace(".", "," if comma else ".") for value in (east, north, 0.5, speed))
        lines.append(f"{cells},{at_work}")
    (folder / "RecPath.txt").write_text("\n".join([*lines, "half a line"]))
    (run,) = read_task_logs(str(folder)).runs
    assert (run.field, run.log_format) == ("Back forty", "AgOpenGPS") and len(run.outline) == 3
    assert any("no clock" in note for note in run.notes) and any("1 unreadable line" in note for note in run.notes)
    what = summarise_run(project_run(run))
    # One row a second was written; while the machine stands a path tells no time.
    assert what.working_mps == pytest.approx(WORK_MPS, abs=0.01)
    assert (what.lifts, what.u_turns) == (TRACKS, TRACKS - 1)


def csv_lines(mark: str = ",", comma: str = ".") -> str:
    time_s, xy, works = drive()
    lines = [mark.join(["Zeitpunkt", "Lon", "Lat", "Tempo", "Arbeit"])]
    for t, (lon, lat), at_work in zip(time_s, lonlat(xy), works, strict=True):
        stamp = f"{START + timedelta(seconds=float(t)):%Y-%m-%d %H:%M:%S}"
        cells = [f"{value:.9f}".replace(".", comma) for value in (lon, lat, 7.2)]
        lines.append(mark.join([stamp, *cells, "yes" if at_work else "no"]))
    return "\n".join(lines)


@pytest.mark.parametrize(("mark", "comma"), [(",", "."), (";", ",")])
def test_a_csv_file_with_a_mapping(tmp_path: Path, mark: str, comma: str) -> None:
    (tmp_path / "log.csv").write_text(csv_lines(mark, comma))
    (tmp_path / "map.toml").write_text(MAPPING)
    (run,) = read_task_logs(str(tmp_path / "log.csv"), str(tmp_path / "map.toml")).runs
    time_s, xy, works = drive()
    np.testing.assert_array_equal(run.time_s, time_s)
    np.testing.assert_allclose(run.lonlat, lonlat(xy), atol=1e-8)
    assert run.is_working is not None and run.speed_mps is not None
    np.testing.assert_array_equal(run.is_working, works)
    np.testing.assert_allclose(run.speed_mps, 2.0)
    assert (run.field, run.width_m, run.start) == ("Lange Wiese", 6.0, "2017-11-29T16:21:32")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("time = ", "tine = "), "'tine' in [columns] (did you mean 'time'?)"),
        (('"Lon"', '"Lom"'), "no column 'Lom' (did you mean 'Lon'?)"),
        (('latitude = "Lat"\n', ""), "does not name the column of latitude"),
        (("width_m = 6.0", "width_m = 600.0"), "use 0.1 to 100 m"),
        (("[columns]", "[colums]"), "does not name columns"),
        (("[values]", "[values"), "is not TOML"),
    ],
)
def test_a_mapping_that_is_wrong_says_where(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    (tmp_path / "log.csv").write_text(csv_lines())
    (tmp_path / "map.toml").write_text(MAPPING.replace(*change))
    with pytest.raises(LogError) as refusal:
        read_task_logs(str(tmp_path / "log.csv"), str(tmp_path / "map.toml"))
    assert words in str(refusal.value)


def plain_lines(stamps: list[object], works: str = "1") -> str:
    places = lonlat(drive()[1])[: len(stamps)].tolist()
    rows = [f"{stamp},{lon:.9f},{lat:.9f},{works}" for stamp, (lon, lat) in zip(stamps, places, strict=True)]
    return "\n".join(["time,lon,lat,works", *rows])


@pytest.mark.parametrize(
    "form", ["%Y-%m-%dT%H:%M:%S", "%Y/%m/%d %H:%M:%S", "%d.%m.%Y %H:%M:%S", "%m/%d/%Y %I:%M:%S %p"]
)
def test_the_start_of_a_csv_file_is_that_of_its_first_usable_row(tmp_path: Path, form: str) -> None:
    stamps: list[object] = [f"{START + timedelta(seconds=second):{form}}" for second in range(60)]
    for first in ("no time", "1970-01-01T00:00:07"):
        (tmp_path / "log.csv").write_text(plain_lines([first, *stamps[1:]]))
        (run,) = read_task_logs(str(tmp_path / "log.csv")).runs
        assert (run.start, run.time_s[0], run.time_s[-1]) == ("2017-11-29T16:21:33", 0.0, 58.0)


@pytest.mark.parametrize("form", ["151197%M%S000", "%Y%m%d%H%M%S", "%H%M%S", "%H:%M:%S"])
def test_times_that_are_not_in_seconds_are_refused(tmp_path: Path, form: str) -> None:
    stamps: list[object] = [f"{START + timedelta(seconds=second):{form}}" for second in range(90)]
    (tmp_path / "log.csv").write_text(plain_lines(stamps))
    with pytest.raises(LogError, match=r"the time column begins with .*; write seconds, or 2020-01-02T17:30:20"):
        read_task_logs(str(tmp_path / "log.csv"))


@pytest.mark.parametrize("first", [3.456e8, 6e5, 5.9e8])
@pytest.mark.parametrize("step", [1000.0, 200.0, 100.0])
def test_milliseconds_of_the_week_are_refused(tmp_path: Path, first: float, step: float) -> None:
    (tmp_path / "log.csv").write_text(plain_lines([f"{first + step * row:.0f}" for row in range(90)]))
    with pytest.raises(LogError, match="which is not in seconds; write seconds, or 2020-01-02T17:30:20"):
        read_task_logs(str(tmp_path / "log.csv"))


@pytest.mark.parametrize(("first", "step"), [(3.456e8, 1.0), (345_600.0, 1.0), (8.4e8, 1.0), (3.456e8, 60.0)])
def test_seconds_of_any_count_are_read(tmp_path: Path, first: float, step: float) -> None:
    (tmp_path / "log.csv").write_text(plain_lines([f"{first + step * row:.0f}" for row in range(90)]))
    (run,) = read_task_logs(str(tmp_path / "log.csv")).runs
    assert run.time_s[-1] == 89.0 * step


@pytest.mark.parametrize(
    ("cell", "at_work"), [("1.00", True), ("255", True), ("TRUE", True), ("0.0", False), ("", False)]
)
def test_what_a_work_state_says(tmp_path: Path, cell: str, at_work: bool) -> None:
    (tmp_path / "log.csv").write_text(plain_lines(list(range(90)), cell))
    (run,) = read_task_logs(str(tmp_path / "log.csv")).runs
    assert run.is_working is not None and (run.is_working == at_work).all()


def test_a_speed_below_zero_is_that_of_reverse_and_no_standstill(tmp_path: Path) -> None:
    lines = csv_lines().replace(",7.200000000,", ",-7.200000000,")
    (tmp_path / "log.csv").write_text(lines)
    (tmp_path / "map.toml").write_text(MAPPING)
    (run,) = read_task_logs(str(tmp_path / "log.csv"), str(tmp_path / "map.toml")).runs
    np.testing.assert_allclose(project_run(run).speed_mps, 2.0)


def test_a_work_state_in_other_words_is_refused(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(plain_lines(list(range(90)), "arbeitet"))
    with pytest.raises(LogError, match="works 'arbeitet' in line 2; write 1, true, on or yes"):
        read_task_logs(str(tmp_path / "log.csv"))


def test_what_is_no_log_is_told(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(csv_lines())
    with pytest.raises(LogError, match="has no column time"):
        read_task_logs(str(tmp_path / "log.csv"))
    with pytest.raises(LogError, match="There is no file or folder"):
        read_task_logs(str(tmp_path / "nothing"))
    with pytest.raises(LogError, match="contains no task log"):
        read_task_logs(str(tmp_path))
    with pytest.raises(LogError, match="no recorded path"):
        read_task_logs(str(agopengps(tmp_path)))
