"""Hiding effects in logs of the independent truth model, and what a diagnosis makes of them."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import pandas as pd

from tests.truth.drives import Drive, default_programme
from tests.truth.effects import scaled
from tests.truth.model import make_logs
from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.diagnosis.results import Diagnosis
from vehicle.identification.logs.reader import build_log
from vehicle.model.tractor import Tractor, load_tractor

BRIEF = ("straight_090", "straight_270", "circles_right", "circles_left", "steps", "speed_steps", "implement_straight")


@lru_cache(maxsize=1)
def eg105() -> Tractor:
    """The nominal tractor."""
    return load_tractor("eg105")


def brief_programme(*more: str) -> list[Drive]:
    """Seven runs of the default programme and those named."""
    return [drive for drive in default_programme() if drive.name in (*BRIEF, *more)]


def hidden(names: Sequence[str], size: float = 1.0) -> dict[str, dict[str, float]]:
    """Effects at a share of their clear sizes."""
    return {name: scaled(name, size) for name in names}


def diagnosed(
    effects: dict[str, dict[str, float]], seed: int, programme: Sequence[Drive] | None = None, **conditions: Any
) -> Diagnosis:
    """The diagnosis of logs in which the truth model hid effects."""
    return told(make_logs(effects, seed, programme, **conditions))


def told(frames: Sequence[pd.DataFrame], tractor: str = "eg105") -> Diagnosis:
    """What a diagnosis says of logs on soil."""
    logs = [build_log(one.reset_index(drop=True), f"run {k}") for k, one in enumerate(frames)]
    return diagnose_logs(logs, load_tractor(tractor), "soil")
