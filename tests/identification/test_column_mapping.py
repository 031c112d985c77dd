"""Logs with columns under other names, in other units and other forms of CSV: refused with a mapping, or read."""

import csv
import io
import shlex
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.identification.log_tables import refusal, table, to_degrees
from vehicle.identification.errors import ColumnError
from vehicle.identification.logs.reader import list_remarks, read_log, read_logs
from vehicle.identification.logs.table import extract_columns, guess_column, map_columns, parse_mapping, read_log_table

# Names of one quantity in the unit of the contract: what people's loggers write.
NAMES = {
    "time_s": ("Zeit", "Zeit [s]", "temps (s)", "tiempo", "tijd", "t_s", "時刻", "GPS Time", "Timestamp"),
    "easting_m": ("X [m]", "Rechtswert", "utm_x", "Este (m)", "East", "Pos X"),
    "northing_m": ("Y [m]", "Hochwert", "utm_y", "Norte (m)", "North", "Pos Y"),
    "heading_deg": ("Kurs [°]", "cap", "Rumbo (deg)", "yaw_deg", "方位角", "Heading"),
    "speed_mps": ("Geschwindigkeit", "vitesse (m/s)", "v_ms", "snelheid", "車速", "speedMps"),
    "steering_deg": ("Lenkwinkel", "Radwinkel [Grad]", "braquage", "stuurhoek", "steeringAngle", "操舵角"),
}
# Of the same columns in other units: name, what the contract's value is multiplied with, and what a mapping says.
UNITS = {
    "time_s": ("Zeit [ms]", 1000.0, "time_ms"),
    "easting_m": ("X [cm]", 100.0, "easting_cm"),
    "northing_m": ("Y/km", 0.001, "northing_km"),
    "heading_deg": ("yaw (rad)", np.pi / 180.0, "heading_rad"),
    "speed_mps": ("v [km/h]", 3.6, "speed_kmh"),
    "steering_deg": ("Lenkwinkel_rad", np.pi / 180.0, "steering_rad"),
}

HEAD = ("time_s", "easting_m", "northing_m", "steering_deg")


def offered(path: Path) -> dict[str, str]:
    with pytest.raises(ColumnError) as caught:
        extract_columns(read_log_table(path), "run")
    return caught.value.mapping


@given(data=st.data())
def test_any_names_in_any_order_give_the_same_log_by_the_mapping_that_is_offered(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("renamed")
    frame = table(40)
    names = {column: data.draw(st.sampled_from([column, *NAMES[column]])) for column in frame}
    renamed = frame.rename(columns=names)[list(data.draw(st.permutations(list(names.values()))))]
    frame.to_csv(folder / "run.csv", index=False)
    renamed.to_csv(folder / "run.csv", index=False)
    is_refused = any(names[column] != column for column in ("time_s", "easting_m", "northing_m", "steering_deg"))
    mapping = offered(folder / "run.csv") if is_refused else {}
    assert mapping == ({key: name for key, name in names.items() if key != name} if is_refused else {})
    found, ignored = extract_columns(
        map_columns(read_log_table(folder / "run.csv"), parse_mapping(mapping), "run"), "run"
    )
    assert len(found) + len(ignored) == len(NAMES)
    for column, values in found.items():
        np.testing.assert_array_equal(values, frame[column], column)


@pytest.mark.parametrize("column", UNITS)
def test_a_unit_in_the_name_is_offered_and_converted(column: str, tmp_path: Path) -> None:
    name, factor, key = UNITS[column]
    frame = table(40).rename(columns={"time_s": "Zeit"})
    frame = frame.rename(columns={"Zeit" if column == "time_s" else column: name})
    frame[name] *= factor
    frame.to_csv(tmp_path / "run.csv", index=False)
    mapping = offered(tmp_path / "run.csv")
    assert mapping[key] == name
    for given_mapping in (mapping, {column if one == key else one: each for one, each in mapping.items()}):
        log = read_log(tmp_path / "run.csv", mapping=given_mapping)
        np.testing.assert_allclose(getattr(log, column), table(40)[column], rtol=1e-12)


def test_everything_that_lacks_is_said_at_once_with_options_to_copy(tmp_path: Path) -> None:
    frame = table(40).set_axis(["Zeit", "X [m]", "Y [m]", "Kurs", "v", "Lenkwinkel"], axis=1)
    frame.to_csv(tmp_path / "run.csv", index=False)
    with pytest.raises(ColumnError) as caught:
        read_log(tmp_path / "run.csv")
    sentence = caught.value.render_sentence(lambda _: "--column")
    assert sentence.startswith("run has no column time_s, easting_m, northing_m, steering_command_deg or steering_deg")
    words = shlex.split(sentence.partition(", add ")[2].removesuffix("."))
    assert words[::2] == ["--column"] * 6
    assert words[1::2][:2] == ["time_s=Zeit", "easting_m=X [m]"]
    assert parse_mapping(words[1::2]) == parse_mapping(caught.value.mapping)


def test_two_candidates_are_a_question_and_not_a_guess(tmp_path: Path) -> None:
    frame = table(40).assign(Zeit=1.0).rename(columns={"time_s": "Timestamp"})
    frame.to_csv(tmp_path / "run.csv", index=False)
    assert offered(tmp_path / "run.csv") == {}
    sentence = refusal(lambda: read_log(tmp_path / "run.csv"))
    assert 'add mapping "time_s=Timestamp" or mapping "time_s=Zeit"' in sentence
    assert read_log(tmp_path / "run.csv", mapping=["time_s=Timestamp"]).rows_used == 40


def test_longitudes_and_latitudes_become_metres_about_one_origin(tmp_path: Path) -> None:
    degrees = to_degrees(table(400)).rename(columns={"easting_m": "Lon", "northing_m": "Lat"})
    for name, rows in (("a", slice(0, 200)), ("b", slice(200, 400))):
        degrees[rows].to_csv(tmp_path / f"{name}.csv", index=False)
    mapping = offered(tmp_path / "a.csv")
    assert mapping == {"longitude_deg": "Lon", "latitude_deg": "Lat"}
    first, second = read_logs([tmp_path / "a.csv", tmp_path / "b.csv"], mapping=mapping)
    assert first.origin_deg == second.origin_deg == (degrees.Lon[0], degrees.Lat[0])
    np.testing.assert_allclose(second.easting_m, table(400).easting_m[200:] - 500.0, atol=1e-3)


@pytest.mark.parametrize(
    ("write", "first_s"),
    [
        (lambda when: when.isoformat(), 1714557600.0),
        (lambda when: when.isoformat().replace("+00:00", "Z"), 1714557600.0),
        (lambda when: when.strftime("%d.%m.%Y %H:%M:%S,%f"), 1714557600.0),
        (lambda when: when.strftime("%H:%M:%S.%f"), 36000.0),
    ],
)
def test_dates_and_times_become_seconds(write: Callable[[Any], str], first_s: float, tmp_path: Path) -> None:
    moments = pd.Timestamp("2024-05-01T10:00:00Z") + pd.to_timedelta(table(40).time_s - 100.0, unit="s")
    frame = table(40).assign(time_s=[write(one) for one in moments]).rename(columns={"time_s": "Zeitstempel"})
    frame.to_csv(tmp_path / "run.csv", index=False)
    log = read_log(tmp_path / "run.csv", mapping=offered(tmp_path / "run.csv"))
    np.testing.assert_allclose(log.time_s, first_s + table(40).time_s - 100.0, atol=1e-6)


def test_gears_and_states_in_words_are_numbers(tmp_path: Path) -> None:
    frame = table(300).assign(shuttle="F", implement="off")
    frame.loc[150:, "implement"] = "On"
    frame.to_csv(tmp_path / "run.csv", index=False)
    log = read_log(tmp_path / "run.csv")
    assert (log.shuttle == 1.0).all() and log.implement.sum() == 150.0


@pytest.mark.parametrize(
    ("mapping", "rule"),
    [
        (["time_s=Zeitt"], "has no column 'Zeitt' (did you mean 'Zeit'?) for mapping time_s=Zeitt"),
        (["tim_s=Zeit"], "mapping tim_s=Zeit is for no column of a log (did you mean 'time_s'?)"),
        (["time_s=Zeit", "time_ms=Kurs"], "mapping time_s=Zeit and time_ms=Kurs are for one column; keep one"),
        (["time_s=Zeit", "roll_deg=Zeit"], "mapping time_s=Zeit and roll_deg=Zeit are for one column; keep one"),
        (["time_s=v [km/h]"], "mapping time_s=v [km/h] contradicts the unit of that column (km/h)"),
        (["speed_mph=v [km/h]"], "mapping speed_mph=v [km/h] contradicts the unit"),
        (["longitude_deg=Kurs"], "mapping has only one of longitude_deg and latitude_deg; add the other"),
        (["Zeit"], "mapping Zeit names no column; write it like time_s=Zeit."),
        ("none.toml", "There is no file 'none.toml'"),
    ],
)
def test_a_mapping_that_cannot_be_used_is_refused_in_a_sentence(mapping: Any, rule: str, tmp_path: Path) -> None:
    frame = table(40).rename(columns={"time_s": "Zeit", "heading_deg": "Kurs"}).assign(**{"v [km/h]": 5.4})
    frame.to_csv(tmp_path / "run.csv", index=False)
    assert rule in refusal(lambda: read_log(tmp_path / "run.csv", mapping=mapping))


def test_a_mapped_column_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("Zeit,Zeit\n1,2\n2,3\n")
    assert "has two columns 'Zeit' for mapping" in refusal(
        lambda: read_log(tmp_path / "run.csv", mapping=["time=Zeit"])
    )


@pytest.mark.parametrize(
    "text",
    [
        "values = 3\n[columns]\ntime_s = 'Zeit'\n",
        "time_s = 3",
        "[columns]\n",
        "time_s",
        "[columns]\ntime_s = ['Zeit']\n",
    ],
)
def test_a_mapping_file_that_names_no_columns_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "columns.toml").write_text(text)
    assert "columns.toml" in refusal(lambda: parse_mapping(tmp_path / "columns.toml"))


def test_a_bad_line_of_a_mapping_file_is_refused_with_the_name_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "columns.toml").write_text('tim_s = "Zeit"')
    assert "columns.toml': tim_s=Zeit is for no column of a log" in refusal(
        lambda: parse_mapping(tmp_path / "columns.toml")
    )


@pytest.mark.parametrize(
    "text",
    [
        'time_ms = "Zeit"',
        'time_ms = "Zeit"\n[values]\nwidth_m = 3',
        '[columns]\ntime_ms = "Zeit"\n[values]\nwidth_m = 3',
    ],
)
def test_a_mapping_file_may_be_that_of_imported_logs(text: str, tmp_path: Path) -> None:
    (tmp_path / "columns.toml").write_text(text)
    assert parse_mapping(tmp_path / "columns.toml") == {"Zeit": ("time_ms", "time_s", 1e-3)}


@pytest.mark.parametrize(
    "name",
    ["engine speed", "rpm", "roll_rate [deg/s]", "Speed [rpm]", "wheel speed", "event", "velocity_x", "angle", "Datum"],
)
def test_a_name_with_a_word_that_is_unknown_is_not_taken_for_a_column(name: str) -> None:
    assert guess_column(name) is None


@given(name=st.text(max_size=20))
def test_any_name_is_nothing_or_a_column_that_a_mapping_can_name(name: str) -> None:
    column = guess_column(name)
    # Latitude and longitude are mapped together only.
    assert column is None or "itude" in column.key or parse_mapping({column.key: "unnamed"}) == {"unnamed": column}


@pytest.mark.parametrize("name", ["_" * 20_000, "speed" * 4_000, "( " * 10_000])
def test_a_very_long_name_is_read_at_once(name: str) -> None:
    start = time.process_time()
    guess_column(name)
    assert time.process_time() - start < 1.0


@pytest.mark.parametrize(
    ("name", "key"),
    [("Lenkwinkelsoll [Grad]", "steering_command_deg"), ("gpstime", "time_s"), ("GPS-Tempo in km/h", "speed_kmh")],
)
def test_compounds_are_read_word_by_word(name: str, key: str) -> None:
    column = guess_column(name)
    assert column is not None and column.key == key


def test_a_remark_says_what_an_ignored_column_may_hold(tmp_path: Path) -> None:
    table(200).drop(columns="speed_mps").assign(**{"v [km/h]": 5.4}).to_csv(tmp_path / "run.csv", index=False)
    (remark,) = list_remarks(read_log(tmp_path / "run.csv"))
    assert remark == "run: column 'v [km/h]' is unknown and was ignored; map it to speed_kmh if that is what it holds."


# --- forms of CSV ------------------------------------------------------------------------------------------------


@given(
    separator=st.sampled_from([(";", "."), (";", ","), ("\t", "."), ("\t", ","), (",", "."), ("|", ",")]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"]),
    end=st.sampled_from(["\n", "\r\n"]),
    quoting=st.sampled_from([0, 1]),
    trailing=st.sampled_from(["", "rows", "all"]),
    names_separator=st.booleans(),
    values=st.lists(st.tuples(*[st.floats(-1e6, 1e6).map(lambda x: round(x, 3))] * 3), min_size=2, max_size=8),
)
def test_any_form_of_csv_gives_the_same_table(
    separator: tuple[str, str], encoding: str, end: str, quoting: int, trailing: str, names_separator: bool,
    values: list[tuple[float, ...]], tmp_path_factory: pytest.TempPathFactory,
) -> None:  # fmt: skip
    path = tmp_path_factory.mktemp("forms") / "run.csv"
    frame = pd.DataFrame(values, columns=["time_s", "Höhe", "a, b; c"]).assign(place="Müllers Acker")
    out = io.StringIO()
    frame.to_csv(out, index=False, sep=separator[0], decimal=separator[1], quoting=quoting)
    head, *lines = out.getvalue().splitlines()
    tail = separator[0] if trailing else ""
    lines = [head + (tail if trailing == "all" else ""), *(line + tail for line in lines)]
    lines = [f"sep={separator[0]}", *lines] if names_separator else lines
    path.write_bytes((end.join(lines) + end).encode(encoding))
    found = read_log_table(path)
    assert list(found) == list(frame) and (found.place == "Müllers Acker").all()
    np.testing.assert_array_equal(found[list(frame)[:3]].astype(float), frame[list(frame)[:3]])


def test_thousands_are_told_from_decimals_and_texts_stay() -> None:
    from fields.text_files import normalise_table

    text = "a;b;c\n1.234,5;-0,25;1,2 km\n1.234.567,0;7;31.12.2024\n"
    assert normalise_table(text) == 'a,b,c\n1234.5,-0.25,"1,2 km"\n1234567.0,7,31.12.2024\n'


def test_a_plain_table_is_left_as_it_is() -> None:
    from fields.text_files import normalise_table

    text = 'time_s,place\r\n1.5,"a; b; c"\r\n\r\n2.5,"d, e"\r\n'
    assert normalise_table(text) is text or normalise_table(text) == text


def test_commas_in_quotes_are_decimal_where_no_number_has_a_point() -> None:
    from fields.text_files import normalise_table

    assert normalise_table('a,b\n"1,5",2\n') == "a,b\n1.5,2\n"
    assert normalise_table('a,b\n"1,5",2.5\n') == 'a,b\n"1,5",2.5\n'


@pytest.mark.parametrize("separator", [";", "\t", "|"])
@pytest.mark.parametrize("point", ["1.5", "1,234.5"])
def test_commas_are_thousands_where_a_number_has_a_point(separator: str, point: str) -> None:
    from fields.text_files import normalise_table

    table = [["a", "b"], *[["512,345", "2"]] * 60, ["7", point]]
    text = "\n".join(map(separator.join, table))
    assert list(csv.reader(io.StringIO(normalise_table(text)))) == table


def test_a_decimal_comma_in_quotes_is_found_in_any_row() -> None:
    from fields.text_files import normalise_table

    rows = "a,b\n" + "1,2\n" * 60
    assert normalise_table(rows + '"1,5",2\n') == rows + "1.5,2\n"
    assert normalise_table(rows) is rows


# --- Cells of a table as numbers ---


def test_cells_are_numbers_or_missing() -> None:
    frame = pd.DataFrame([["0", " 1.5 ", "2e1", "-3"], ["1", "", "NaN", "n/a"]], columns=list(HEAD)).assign(rpm="1800")
    columns, others = extract_columns(frame, "run")
    assert others == ("rpm",) and set(columns) == set(HEAD)
    assert columns["easting_m"][0] == 1.5 and columns["northing_m"][0] == 20.0
    assert all(np.isnan(columns[name][1]) for name in HEAD[1:])


def test_a_column_without_a_number_counts_as_absent() -> None:
    frame = pd.DataFrame([["0", "1", "2", "3", ""], ["1", "1", "2", "3", ""]], columns=[*HEAD, "heading_deg"])
    assert "heading_deg" not in extract_columns(frame, "run")[0]


@pytest.mark.parametrize("column", HEAD)
def test_what_is_needed_is_named(column: str) -> None:
    frame = pd.DataFrame([["0", "1", "2", "3"]] * 2, columns=list(HEAD)).drop(columns=column)
    assert column in refusal(lambda: extract_columns(frame, "run"))
