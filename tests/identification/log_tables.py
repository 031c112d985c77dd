"""Tables of logs, right ones and spoiled ones."""

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.truth.model import make_logs
from vehicle.errors import VehicleError
from vehicle.identification.errors import LogError
from vehicle.identification.logs.readings import SPEED_UNITS, LogConvention

HOME = (141.3545, 43.0686)  # longitude and latitude of a field in Sapporo
BENT = ("circles_right", "circles_left", "steps", "figure_eight", "fast_circles", "fast_steps")


def table(rows: int = 200, rate_hz: float = 20.0) -> pd.DataFrame:
    """A drive to the north-east at 1.5 m/s with the steering at 0.2 deg."""
    time = np.arange(rows) / rate_hz
    way = 1.5 * time * np.sqrt(0.5)
    return pd.DataFrame(
        {
            "time_s": 100.0 + time,
            "easting_m": 500.0 + way,
            "northing_m": 700.0 + way,
            "heading_deg": 45.0,
            "speed_mps": 1.5,
            "steering_deg": 0.2,
        }
    )


@lru_cache(maxsize=1)
def runs() -> dict[str, pd.DataFrame]:
    return {frame.attrs["name"]: frame for frame in make_logs({}, 11, rate_hz=10.0)}


def saved(frame: pd.DataFrame, path: Path) -> Path:
    frame.to_csv(path, index=False)
    return path


def refusal(call: Callable[[], object]) -> str:
    with pytest.raises(LogError) as caught:
        call()
    text = str(caught.value)
    assert isinstance(caught.value, VehicleError) and "\n" not in text.strip() and text.endswith(".")
    return text


def to_degrees(frame: pd.DataFrame) -> pd.DataFrame:
    """Longitude and latitude by a sphere-free geodesic: pyproj's local projection about the first position."""
    from pyproj import Transformer

    local = Transformer.from_crs(
        f"+proj=aeqd +lon_0={HOME[0]} +lat_0={HOME[1]} +ellps=WGS84", "EPSG:4326", always_xy=True
    )
    east, north = frame.easting_m - frame.easting_m[0], frame.northing_m - frame.northing_m[0]
    longitude, latitude = local.transform(east.to_numpy(), north.to_numpy())
    return frame.assign(easting_m=longitude, northing_m=latitude)


def in_unit(factor: float, *columns: str) -> Callable[[pd.DataFrame], pd.DataFrame]:
    return lambda frame: frame.assign(**{name: frame[name] * factor for name in columns if name in frame})


def held(frame: pd.DataFrame, rows: int, *names: str, interpolated: bool = False) -> pd.DataFrame:
    """The log with columns refreshed every so many rows, repeated or drawn straight in between."""
    place, time = np.arange(len(frame)), frame.time_s.to_numpy()
    columns = {}
    for name in names:
        values = frame[name].to_numpy()
        if interpolated:
            values = np.unwrap(values, period=360.0) if name == "heading_deg" else values
            values = np.interp(time, time[::rows], values[::rows])
            columns[name] = values % 360.0 if name == "heading_deg" else values
        else:
            columns[name] = values[place // rows * rows]
    return frame.assign(**columns)


def swapped(frame: pd.DataFrame) -> pd.DataFrame:
    """Easting in the column of northing and the other way round."""
    return frame.assign(easting_m=frame.northing_m, northing_m=frame.easting_m)


def turned(degrees: float) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """Headings off by an angle."""
    return lambda frame: frame.assign(heading_deg=(frame.heading_deg + degrees) % 360.0)


SPOIL: dict[LogConvention, Callable[[pd.DataFrame], pd.DataFrame]] = {
    LogConvention.TIME_MS: in_unit(1000.0, "time_s"),
    LogConvention.TIME_US: in_unit(1.0e6, "time_s"),
    LogConvention.TIME_NS: in_unit(1.0e9, "time_s"),
    LogConvention.EAST_NORTH_SWAPPED: swapped,
    LogConvention.POSITION_DEGREES: to_degrees,
    LogConvention.POSITION_KM: in_unit(0.001, "easting_m", "northing_m"),
    LogConvention.POSITION_FEET: in_unit(1.0 / 0.3048, "easting_m", "northing_m"),
    **{
        fix: in_unit(factor, *columns)
        for factor, fixes in zip((3.6, 3600.0 / 1609.344, 3600.0 / 1852.0), SPEED_UNITS, strict=True)
        for fix, columns in zip(
            fixes, (("speed_mps", "speed_command_mps"), ("speed_mps",), ("speed_command_mps",)), strict=True
        )
    },
    LogConvention.HEADING_RADIANS: in_unit(np.pi / 180.0, "heading_deg"),
    LogConvention.HEADING_CCW_EAST: lambda frame: frame.assign(heading_deg=(90.0 - frame.heading_deg) % 360.0),
    LogConvention.HEADING_CCW_NORTH: lambda frame: frame.assign(heading_deg=-frame.heading_deg % 360.0),
    LogConvention.HEADING_REVERSED: turned(180.0),
    LogConvention.STEERING_RADIANS: in_unit(np.pi / 180.0, "steering_deg", "steering_command_deg"),
    LogConvention.STEERING_LEFT: in_unit(-1.0, "steering_deg", "steering_command_deg"),
}
