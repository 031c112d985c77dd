"""Time logs of ISOXML: a drive that is known comes back, whole or cut off, from folders and zips."""

import re
import struct
import zipfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from fields.errors import HeadlandError
from fields.terrain.point_files import RTK_FIXED
from fields.text_files import count_noun
from planner.pipeline.example_logs import DDI_COLUMNS, encode_records
from planner.task_logs.formats.isoxml_logs import TLG_EPOCH, parse_time_log
from planner.task_logs.formats.log_format import format_time
from planner.task_logs.log_import import import_runs, read_task_logs
from planner.task_logs.runs.phases import classify_phases, summarise_run
from planner.task_logs.runs.run_files import load_imported_run
from planner.task_logs.runs.run_records import compute_course_deg, project_run
from reports.task_logs.run_results import STANDING, TURNING, WORKING
from tests.works.conftest import (
    HEADER,
    STOP_S,
    TRACK_M,
    TRACKS,
    TURN_S,
    WIDTH_M,
    WORK_MPS,
    binary,
    drive,
    lonlat,
    main_file,
    values,
)
from vehicle.identification.errors import LogError
from vehicle.identification.logs.reader import read_log


def test_a_drive_comes_back(taskdata: Path) -> None:
    found = read_task_logs(str(taskdata))
    (run,) = found.runs
    assert found.notes == ()
    time_s, xy, works = drive()
    assert (run.name, run.field, run.start, run.width_m) == ("TLG00001", "Long acre", "2026-05-04T08:00:00", WIDTH_M)
    assert run.outline_m2 == 3300.0 and len(run.outline[0]) in (4, 5)
    np.testing.assert_array_equal(run.time_s, time_s)
    np.testing.assert_array_equal(run.is_working, works)
    np.testing.assert_allclose(run.lonlat, lonlat(xy), atol=1e-7)


def test_figures_by_hand(taskdata: Path) -> None:
    run = project_run(read_task_logs(str(taskdata)).runs[0])
    what, done = summarise_run(run), classify_phases(run)
    track_s = TRACK_M / WORK_MPS
    assert what.seconds == TRACKS * track_s + STOP_S + (TRACKS - 1) * TURN_S
    assert what.by_kind_s[STANDING] == what.stops_s == STOP_S and what.stops == 1
    # A turn begins with the first row off work, which is its first place; work ends one step before it.
    assert what.by_kind_s[TURNING] == (TRACKS - 1) * TURN_S
    assert what.by_kind_s[WORKING] == TRACKS * track_s
    assert (what.lifts, what.turns, what.u_turns) == (TRACKS, TRACKS - 1, TRACKS - 1)
    assert what.active_m == pytest.approx(TRACKS * TRACK_M, abs=0.01)
    assert what.area_m2 == pytest.approx(TRACKS * TRACK_M * WIDTH_M, abs=1.0) and what.area_counted
    assert what.placed_m == pytest.approx(what.counted_m, rel=2e-3)
    assert what.working_mps == pytest.approx(WORK_MPS, abs=1e-3)
    for turn in done.turns:
        assert turn.bend_deg == pytest.approx(180.0, abs=1.0)
        assert turn.offset_m == pytest.approx(WIDTH_M, abs=0.05)


def test_course_over_ground() -> None:
    xy = np.array([[0.0, 0.0], [0.0, 0.1], [0.0, 1.0], [1.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
    np.testing.assert_allclose(compute_course_deg(xy), [0.0, 0.0, 90.0, 180.0, 180.0, 270.0, 270.0])
    assert (compute_course_deg(np.zeros((3, 2))) == 0.0).all()


def test_a_log_cut_off_anywhere_keeps_what_is_whole() -> None:
    whole = binary()[:400]
    counts, ends = [], [0]
    place = 0
    while place + 15 < len(whole) and place + 16 + 5 * whole[place + 15] <= len(whole):
        place += 16 + 5 * whole[place + 15]
        ends.append(place)
    for size in range(len(whole) + 1):
        log = parse_time_log(HEADER.encode(), whole[:size], "TLG00001")
        expected = sum(end <= size for end in ends[1:])
        assert len(log.time_s) == expected and log.lost_bytes == size - ends[expected]
        counts.append(len(log.time_s))
    assert counts == sorted(counts) and counts[-1] > 10


def test_a_log_out_of_step_ends_there() -> None:
    head = struct.pack("<IHiiB", 0, 16_000, 480_000_000, 150_000_000, RTK_FIXED)
    good, bad = head + b"\x01" + struct.pack("<Bi", 0, 7), head + b"\x01" + struct.pack("<Bi", len(DDI_COLUMNS), 7)
    log = parse_time_log(HEADER.encode(), good + bad + good, "x")
    assert len(log.time_s) == 1 and log.lost_bytes == len(bad + good)


def test_the_cut_is_told_and_the_rest_of_the_task_read(taskdata: Path) -> None:
    (taskdata / "TASKDATA.XML").write_text(main_file('<TLG A="TLG00001"/><TLG A="TLG00002"/><TLG A="TLG00003"/>'))
    (taskdata / "TLG00002.xml").write_text(HEADER)
    (taskdata / "TLG00002.bin").write_bytes(binary()[:-3])
    found = import_runs([str(taskdata)])
    assert [run.name for run in found.runs] == ["TLG00001", "TLG00002"]
    rows = len(drive()[0]) - 1
    assert any(f"after {rows} records skipped: not a complete record" in note for note in found.runs[1].notes)
    assert found.notes == ("TLG00003 is skipped: TLG00003.xml is missing in the folder; copy the whole folder.",)


def test_zips_and_capitals(taskdata: Path, tmp_path: Path) -> None:
    pack = tmp_path / "stick.zip"
    with zipfile.ZipFile(pack, "w") as archive:
        archive.write(taskdata / "TASKDATA.XML", "USB/TASKDATA/taskdata.xml")
        archive.write(taskdata / "TLG00001.xml", "USB/TASKDATA/TLG00001.XML")
        archive.write(taskdata / "TLG00001.bin", "USB/TASKDATA/tlg00001.BIN")
    again, first = read_task_logs(str(pack)).runs[0], read_task_logs(str(taskdata / "TASKDATA.XML")).runs[0]
    np.testing.assert_array_equal(again.lonlat, first.lonlat)


def test_rows_without_a_place_or_out_of_order_are_counted(taskdata: Path) -> None:
    time_s, xy, works = drive()
    places = lonlat(xy)
    places[3] = 0.0
    places[40] += 0.5  # fifty kilometres in a second
    time_s[60] = 5.0
    (taskdata / "TLG00001.bin").write_bytes(encode_records(time_s, places, values(time_s, xy, works)))
    (run,) = read_task_logs(str(taskdata)).runs
    assert len(run.time_s) == len(time_s) - 3
    for words in ("1 row without a position", "1 row out of order in time", "1 row with an impossible jump"):
        assert any(words in note for note in run.notes), run.notes


def test_a_run_starts_at_its_first_row_with_a_place(taskdata: Path) -> None:
    time_s, xy, works = drive()
    places = lonlat(xy)
    places[:30] = 0.0  # the receiver has no position yet
    (taskdata / "TLG00001.bin").write_bytes(encode_records(time_s, places, values(time_s, xy, works)))
    (run,) = read_task_logs(str(taskdata)).runs
    assert run.time_s[0] == 0.0 and run.start.endswith("T08:00:30")


def test_a_terminal_that_forgets_midnight(taskdata: Path) -> None:
    time_s, xy, works = drive()
    late = time_s + 57_500.0  # from 23:58:20 on
    data = bytearray(encode_records(late, lonlat(xy), values(time_s, xy, works)))
    place = 0
    while place < len(data):
        struct.pack_into("<H", data, place + 4, 17_000)
        place += 16 + 5 * data[place + 15]
    (taskdata / "TLG00001.bin").write_bytes(bytes(data))
    (run,) = read_task_logs(str(taskdata)).runs
    np.testing.assert_array_equal(run.time_s, time_s)
    assert any("midnight" in note for note in run.notes)


@pytest.mark.parametrize(("rows", "day"), [
    (range(5), 0), ((100,), 0), (range(200, 211), 65_535), (range(150), 0), (range(150), 5),
])  # fmt: skip
def test_rows_whose_day_the_receiver_did_not_know_last_no_years(taskdata: Path, rows: Iterable[int], day: int) -> None:
    data, place, starts = bytearray(binary()), 0, []
    while place < len(data):
        starts.append(place)
        place += 16 + 5 * data[place + 15]
    for row in rows:
        struct.pack_into("<H", data, starts[row] + 4, day)
    (taskdata / "TLG00001.bin").write_bytes(bytes(data))
    (run,) = read_task_logs(str(taskdata)).runs
    assert run.time_s[-1] <= drive()[0][-1] and run.start.startswith("2026-05-04T08:0")
    assert [note for note in run.notes if "midnight" in note] == []
    assert f"{count_noun(len(tuple(rows)), 'row')} whose day the receiver did not know skipped" in run.notes


def test_a_log_without_any_day_is_read_and_has_no_start(taskdata: Path) -> None:
    data, place = bytearray(binary()), 0
    while place < len(data):
        struct.pack_into("<H", data, place + 4, 65_535)
        place += 16 + 5 * data[place + 15]
    (taskdata / "TLG00001.bin").write_bytes(bytes(data))
    (run,) = read_task_logs(str(taskdata)).runs
    np.testing.assert_array_equal(run.time_s, drive()[0])
    assert run.start == "" and not any("skipped" in note for note in run.notes)


def test_speeds_of_makers_by_what_their_device_shows(taskdata: Path) -> None:
    header = HEADER.replace("018D", "EA7E")
    (taskdata / "TLG00001.xml").write_text(header)
    device = (
        '<DVC A="DVC-1"><DET A="DET-1" B="1" C="1" E="0" F="0"><DOR A="7"/></DET>'
        '<DPD A="7" B="EA7E" C="1" D="1" E="speed" F="9"/><DVP A="9" B="0" C="0.1" D="1" E="km/h"/></DVC>'
    )
    (taskdata / "TASKDATA.XML").write_text(main_file().replace("<PFD", device + "<PFD"))
    time_s, xy, works = drive()
    table = values(time_s, xy, works)
    table[:, DDI_COLUMNS.index("018D")] = 72  # tenths of km/h
    (taskdata / "TLG00001.bin").write_bytes(encode_records(time_s, lonlat(xy), table))
    np.testing.assert_allclose(read_task_logs(str(taskdata)).runs[0].speed_mps, 2.0)


def test_sections_say_when_an_implement_without_a_work_state_works(taskdata: Path) -> None:
    (taskdata / "TLG00001.xml").write_text(HEADER.replace("008D", "00A1"))
    time_s, xy, works = drive()
    table = values(time_s, xy, works)
    # Sections 1 to 4 off (0), on (1), in error (2), not there (3): 0b11_10_01_00 is at work, 0b11_10_10_00 is not.
    table[:, DDI_COLUMNS.index("008D")] = np.where(works, 0b11100100, 0b11101000)
    (taskdata / "TLG00001.bin").write_bytes(encode_records(time_s, lonlat(xy), table))
    (run,) = read_task_logs(str(taskdata)).runs
    np.testing.assert_array_equal(run.is_working, works)
    assert "the work state is from the sections: working if any section is on" in run.notes


def test_entities_and_files_that_lead_out_are_refused(taskdata: Path, tmp_path: Path) -> None:
    bomb = '<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>' + main_file().split("?>", 1)[1]
    (taskdata / "TASKDATA.XML").write_text(bomb)
    with pytest.raises(HeadlandError, match="entities"):
        read_task_logs(str(taskdata))
    pack = tmp_path / "out.zip"
    with zipfile.ZipFile(pack, "w") as archive:
        archive.writestr("../TASKDATA.XML", main_file())
    with pytest.raises(HeadlandError, match="a path outside the archive"):
        read_task_logs(str(pack))


def test_run_files_read_back_and_diagnosis_refuses_them_for_what_they_lack(taskdata: Path, tmp_path: Path) -> None:
    found = import_runs([str(taskdata)])
    for name, text in found.files.items():
        (tmp_path / name).write_text(text)
    assert sorted(found.files) == ["2026-05-04_Long-acre_TLG00001.csv", "2026-05-04_Long-acre_TLG00001.json"]
    log = tmp_path / "2026-05-04_Long-acre_TLG00001.csv"
    again, first = load_imported_run(log), project_run(read_task_logs(str(taskdata)).runs[0])
    np.testing.assert_allclose(again.xy, first.xy, atol=6e-4)
    np.testing.assert_array_equal(again.is_working, first.is_working)
    assert again.counters == first.counters and again.crs == first.crs
    assert again.outline is not None and first.outline is not None
    assert again.outline.area == pytest.approx(first.outline.area, rel=1e-4)
    one, other = summarise_run(again), summarise_run(first)
    assert one.by_kind_s == pytest.approx(other.by_kind_s) and one.lifts == other.lifts
    with pytest.raises(LogError, match="has no column steering_command_deg or steering_deg"):
        read_log(log)


@pytest.mark.parametrize("change", [(r'C="([\d.]+)" D="([\d.]+)"/>', r'C="\2" D="\1"/>'), (' C="48', ' C="98')])
def test_an_outline_that_lies_elsewhere_distorts_no_run(taskdata: Path, change: tuple[str, str]) -> None:
    placed_m = import_runs([str(taskdata)]).runs[0].figures.placed_m
    (taskdata / "TASKDATA.XML").write_text(re.sub(*change, main_file()))
    (run,) = import_runs([str(taskdata)]).runs
    assert run.figures.placed_m == pytest.approx(placed_m)
    assert any("outline of its field is not used" in note for note in run.notes)


@pytest.mark.parametrize("area", ["1e999", "-1", "0", "large"])
def test_an_area_that_no_field_has_is_not_used(taskdata: Path, area: str) -> None:
    (taskdata / "TASKDATA.XML").write_text(main_file().replace('D="3300"', f'D="{area}"'))
    (run,) = read_task_logs(str(taskdata)).runs
    assert run.outline_m2 is None and import_runs([str(taskdata)]).files


def test_names_of_files_keep_letters_that_are_not_ascii(taskdata: Path) -> None:
    (taskdata / "TASKDATA.XML").write_text(main_file().replace("Long acre", "Højgård Straße"), encoding="utf-8")
    assert "2026-05-04_Hojgard-Strasse_TLG00001.csv" in import_runs([str(taskdata)]).files


def test_moments() -> None:
    assert format_time(TLG_EPOCH, 0.0) == "1980-01-01T00:00:00"
    assert format_time(TLG_EPOCH, 86_400.0 * 366 + 3_661.0) == "1981-01-01T01:01:01"
    assert format_time(TLG_EPOCH, 1e18) == ""


def test_logged_heights_are_read_in_metres(taskdata: Path) -> None:
    time_s, xy, works = drive()
    records, offset, rows = encode_records(time_s, lonlat(xy), values(time_s, xy, works)), 0, []
    heights_m = 210.0 + 0.01 * np.arange(len(xy))
    for height_m in heights_m.tolist():  # a record has 15 bytes of head, a count and 5 bytes for each value
        place, count = offset + 14, records[offset + 15]
        rows.append(
            records[offset:place] + struct.pack("<i", round(1e3 * height_m)) + records[place : place + 2 + 5 * count]
        )
        offset = place + 2 + 5 * count
    header = HEADER.replace('<PTN A="" B="" D=""/>', '<PTN A="" B="" C="" D=""/>')
    (taskdata / "TLG00001.xml").write_text(header, encoding="utf-8")
    (taskdata / "TLG00001.bin").write_bytes(b"".join(rows))
    (run,) = read_task_logs(str(taskdata)).runs
    assert run.elevation_m is not None
    np.testing.assert_allclose(run.elevation_m, heights_m, atol=1e-9)
    np.testing.assert_allclose(run.lonlat, lonlat(xy), atol=1e-7)
