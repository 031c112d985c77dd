"""What all references keep to: they import nothing that they test, and their seed decides their logs."""

import ast
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.examples import draw_seed
from tests.truth.cases import TruthCase
from tests.truth.drives import default_programme, three_speeds_programme
from tests.truth.model import make_logs
from tests.truth.second import second_logs
from tests.truth.third import make_third_logs

LIBRARIES = {"numpy", "pandas", "numba", "math", "dataclasses", "collections", "typing", "functools", "__future__",
             "sys", "pathlib"}  # fmt: skip
MAKERS: dict[str, Callable[[int], list[pd.DataFrame]]] = {
    "first": lambda seed: make_logs({}, seed, default_programme()[:3]),
    "second": lambda seed: second_logs({}, seed, three_speeds_programme()[6:]),
    "third": lambda seed: make_third_logs(TruthCase("clean", seed, programme="one_sided")),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=pytest.mark.matrix if one == "third" else ()) for one in MAKERS]
)
def test_logs_are_decided_by_their_seed(name: str) -> None:
    seed = draw_seed()
    for one, two, three in zip(*(MAKERS[name](number) for number in (seed, seed, seed + 1)), strict=True):
        pd.testing.assert_frame_equal(one, two, check_exact=True)
        assert not one["easting_m"].equals(three["easting_m"]) and one.attrs["name"]
        assert (np.diff(one["time_s"]) > 0.0).all() and (one["speed_mps"].dropna() >= 0.0).all()
        assert one.notna().all(axis=None)
        assert one["heading_deg"].dropna().between(0.0, 360.0).all()


def test_references_import_nothing_that_they_test() -> None:
    """Libraries and each other, and the first two references nothing of each other's bodies and instruments."""
    for path in Path(__file__).parent.glob("*.py"):
        if path.stem.startswith("test_"):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert all(one.split(".")[0] in LIBRARIES or one.startswith("tests.truth") for one in names), path.name
            if path.stem in ("second", "rolling") or path.stem.startswith("third"):
                assert not {f"tests.truth.{one}" for one in ("model", "body", "sensors")} & set(names), path.name
