"""The GNSS error simulator: search, table, draws, files, and errors inside the loop."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fields.arrays import Floats
from vehicle.errors import VehicleError
from vehicle.model.gnss import (
    GRID_CELLS,
    build_error_table,
    draw_errors,
    find_error_row,
    format_error_table,
    load_default_error_table,
    load_error_table,
    load_static_fixes,
    make_error_keys,
)
from vehicle.sim.world import World

SEED, FIX_COUNT = 20240, 8000
COUNTS = st.lists(st.integers(1, 50), min_size=1, max_size=40)


def table_of(counts: list[int]) -> Any:
    """A table whose cells, side by side, hold these counts."""
    ends = np.cumsum(counts)
    places = np.column_stack([np.arange(len(counts)), np.zeros(len(counts))])
    return np.column_stack([places, ends - counts, ends]).astype(np.int64)


def simulate_static_fixes() -> Floats:
    """8000 synthetic static fixes of an RTK receiver, (8000, 2) in mm east and north.

    Generated, not measured: a slow wander of the solution (a first-order Gauss-Markov process, 60 s at 10 Hz) and white
    noise of each fix, together 3.2 mm east and 4.1 mm north, the usual size of the horizontal scatter of a fixed
    solution over minutes (maker's figure of 8 mm + 1 ppm is an upper bound over days), cut at the edge of the grid
    and rounded to the receiver's millimetre.
    """
    random = np.random.default_rng(SEED)
    persistence, scale = math.exp(-0.1 / 60.0), np.array([3.2, 4.1])
    wander = np.empty((FIX_COUNT, 2))
    value = random.normal(size=2)
    for row in wander:
        value = persistence * value + math.sqrt(1.0 - persistence * persistence) * random.normal(size=2)
        row[:] = value
    wander = (wander - wander.mean(axis=0)) / wander.std(axis=0)
    fixes = scale * (0.8 * wander + 0.6 * random.normal(size=wander.shape))
    return np.asarray(np.round(np.clip(fixes, -14.0, 14.0)))


@given(COUNTS)
def test_every_draw_finds_the_row_whose_interval_holds_it(counts: list[int]) -> None:
    table = table_of(counts)
    found = [find_error_row(table, sigma) for sigma in range(1, sum(counts) + 1)]
    assert found == np.repeat(np.arange(len(counts)), counts).tolist()


def test_a_draw_on_a_border_belongs_to_the_row_it_closes() -> None:
    """Algorithm 1 printed: sigma = a steps back from wherever the search stands; here (0, 2], (2, 5], (5, 9]."""
    table = table_of([2, 3, 4])
    assert [find_error_row(table, sigma) for sigma in (1, 2, 3, 5, 6, 9)] == [0, 0, 1, 1, 2, 2]


def test_all_sigmas_once_give_the_table_back() -> None:
    table = load_default_error_table()
    rows = np.array([find_error_row(table, sigma) for sigma in range(1, int(table[-1, 3]) + 1)])
    drawn = table[rows, :2].astype(float)
    assert (build_error_table(drawn[:, 0] + 7000.0, drawn[:, 1] - 300.0) == table).all()


@pytest.mark.slow
def test_draws_follow_the_table() -> None:
    """Pearson's chi-square over the cells; its mean is the degrees of freedom, its variance twice that."""
    table, count = load_default_error_table(), 200_000
    expected = (table[:, 3] - table[:, 2]) / table[-1, 3] * count
    for key in make_error_keys(3, 2):
        drawn = draw_errors(int(key), count, table)
        cells = {(int(x), int(y)): row for row, (x, y) in enumerate(table[:, :2])}
        found = np.bincount([cells[int(x), int(y)] for x, y in drawn], minlength=len(table))
        chi_square = float(((found - expected) ** 2 / expected).sum())
        freedom = len(table) - 1
        assert abs(chi_square - freedom) < 4.0 * math.sqrt(2.0 * freedom)


def test_draws_come_one_after_another_without_a_trace_of_the_last() -> None:
    drawn = draw_errors(11, 100_000, load_default_error_table()).astype(float)
    for axis in (0, 1):
        series = drawn[:, axis] - drawn[:, axis].mean()
        for lag in (1, 2, 5):
            assert abs((series[lag:] * series[:-lag]).mean() / series.var()) < 4.0 / math.sqrt(len(series))


def test_a_table_from_draws_is_like_its_source() -> None:
    drawn = draw_errors(5, 50_000, load_default_error_table()).astype(float)
    again = build_error_table(drawn[:, 0], drawn[:, 1])
    weights = (again[:, 3] - again[:, 2])[:, None] / again[-1, 3]
    fixes = simulate_static_fixes()
    spread = np.sqrt((weights * again[:, :2] ** 2).sum(axis=0))
    assert spread == pytest.approx(fixes.std(axis=0), rel=0.02)


def test_the_table_that_comes_along_is_made_from_8000_fixes() -> None:
    fixes = simulate_static_fixes()
    assert fixes.shape == (8000, 2)
    table = build_error_table(fixes[:, 0], fixes[:, 1])
    assert (table == load_default_error_table()).all()
    assert table[0, 2] == 0 and table[-1, 3] == 8000
    assert (table[1:, 2] == table[:-1, 3]).all()
    assert (np.diff(table[:, 3] - table[:, 2]) >= 0).all()
    assert table[:, :2].min() >= -GRID_CELLS // 2 and table[:, :2].max() < GRID_CELLS // 2


def test_keys_belong_to_seed_and_tractor() -> None:
    table = load_default_error_table()
    one = draw_errors(int(make_error_keys(1, 3)[0]), 500, table)
    assert (one == draw_errors(int(make_error_keys(1, 9)[0]), 500, table)).all()
    assert not (one == draw_errors(int(make_error_keys(1, 3)[1]), 500, table)).all()
    assert not (one == draw_errors(int(make_error_keys(2, 3)[0]), 500, table)).all()


def errant(plan: Any, tractor: Any, implement: Any, seed: int, *, slow: bool = False) -> Any:
    world = World(plan, tractor, implement, position_errors=load_default_error_table(), seed=seed)
    return world.run(max_time_s=20.0, slow=slow).record


def test_the_same_seed_gives_the_same_bytes(build: Any, eg105: Any, implement: Any) -> None:
    plan = build.plan(build.two_passes(), build.two_passes(30.0))
    one = errant(plan, eg105, implement, 4)
    assert one.tobytes() == errant(plan, eg105, implement, 4).tobytes()
    assert one.tobytes() != errant(plan, eg105, implement, 5).tobytes()
    # Both drive the same path 30 m apart, each with errors of its own, and weave by millimetres.
    apart = one[:, 1, 0] - one[:, 0, 0] - 30.0
    assert 1e-4 < np.abs(apart).max() < 0.05


def test_without_a_table_nothing_errs(build: Any, eg105: Any, implement: Any) -> None:
    plan = build.plan([build.leg((0, 0), (0, 30))])
    assert np.abs(World(plan, eg105, implement, seed=9).run(max_time_s=15.0).record[:, 0, 0]).max() < 1e-9


def test_the_slow_loop_draws_the_same_errors(build: Any, eg105: Any, implement: Any) -> None:
    plan = build.plan(build.two_passes())
    fast, slow = (errant(plan, eg105, implement, 7, slow=slow) for slow in (False, True))
    assert np.abs(fast - slow).max() < 1e-9


def write_fixes(path: Path, rows: list[str], header: str = "x_m,y_m") -> Path:
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def test_metres_and_degrees_give_the_same_table(tmp_path: Path) -> None:
    fixes = simulate_static_fixes()[:2000]
    fixes = fixes - np.round(fixes.mean(axis=0))
    metres = write_fixes(tmp_path / "m.csv", [f"{x / 1000:.4f},{y / 1000:.4f}" for x, y in fixes])
    # One degree of latitude and longitude at 43 degrees north on WGS 84, in metres.
    east, north = 81541.40, 111088.70
    degrees = write_fixes(
        tmp_path / "d.csv",
        [f"{43.0 + y / 1000 / north:.12f},{141.0 + x / 1000 / east:.12f}" for x, y in fixes],
        "latitude,longitude",
    )
    one, other = (build_error_table(*load_static_fixes(path)) for path in (metres, degrees))
    assert one[-1, 3] == other[-1, 3] == 2000
    assert np.abs(one[-20:, :2].mean(axis=0) - other[-20:, :2].mean(axis=0)).max() < 0.5


def test_a_table_survives_its_file(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text(format_error_table(load_default_error_table()), encoding="utf-8")
    assert (load_error_table(path) == load_default_error_table()).all()


@pytest.mark.parametrize(("rows", "header", "words"), [
    (["0,0"] * 99, "x_m,y_m", "holds 99 fixes; a GNSS table needs 100 or more"),
    (["0,0"] * 120 + ["a,1"], "x_m,y_m", "line 122: 'a, 1' are not numbers"),
    (["0,0"] * 120 + ["nan,1"], "x_m,y_m", "line 122: 'nan, 1' are not numbers"),
    (["0,0"] * 120, "east,north", "columns east, north; fixes need x_m, y_m"),
    ([], "x_m,y_m", "holds 0 fixes"),
])  # fmt: skip
def test_bad_files_are_refused(tmp_path: Path, rows: list[str], header: str, words: str) -> None:
    with pytest.raises(VehicleError, match=words):
        load_static_fixes(write_fixes(tmp_path / "fixes.csv", rows, header))


def test_fixes_beyond_the_grid_are_refused() -> None:
    east = np.zeros(200)
    east[-1] = 40.0
    with pytest.raises(VehicleError, match=r"reach 40 mm from their mean, but the grid only 16 mm each way"):
        build_error_table(east, np.zeros(200))


@pytest.mark.parametrize("text", [
    "east_mm,north_mm,above,up_to\n0,0,1,5\n",
    "east_mm,north_mm,above,up_to\n0,0,0,5\n1,0,6,9\n",
    "east_mm,north_mm,above,up_to\n0.5,0,0,5\n",
    "east_mm,north_mm,above,up_to\n",
])  # fmt: skip
def test_a_garbled_table_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(VehicleError, match=r"is no GNSS table"):
        load_error_table(path)
