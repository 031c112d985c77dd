"""How the benchmarks `answers` and `growth` draw jobs, plan them apart, and count."""

import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from fields.geometry.field import Field
from tests.benchmarks.answers import ROOT, compute_time_over, find_tenth_worst, iter_rows, read_rows, report
from tests.benchmarks.drawn_jobs import (
    LEAST_WIDTHS,
    MADE_HA,
    MAX_OBSTACLES,
    RADII_M,
    SPEEDS_KMH,
    WIDTHS_M,
    choose_parcels,
    draw_job,
)
from tests.benchmarks.growth import build_outline, build_sized_job, choose_sizes, draw_points, fit_exponent
from tests.benchmarks.machine_fields import measure_fit
from tests.benchmarks.planned_jobs import (
    build_field,
    build_lost_answer,
    build_tractor,
    measure_session_cpu_s,
    plan_apart,
)
from tests.examples import count_examples

T = TypeVar("T")
POND_HOLE = shapely.box(40.0, 30.0, 52.0, 44.0)
PARCELS = (
    Field("p2", shapely.box(0.0, 0.0, 210.0, 120.0).difference(POND_HOLE)),
    Field("p1", shapely.box(0.0, 0.0, 90.0, 80.0)),
)


@settings(max_examples=count_examples(30))
@given(st.integers(0, 100_000))
def test_a_seed_draws_a_job_within_its_limits(seed: int) -> None:
    """The same seed gives the same job, whatever the order of parcels; all that is drawn lies inside its field."""
    job = draw_job(seed, PARCELS)
    assert json.loads(json.dumps(job)) == job == draw_job(seed, PARCELS[::-1])
    field = build_field(job)
    across_m = measure_fit(Field("drawn", field.boundary), 3.0, 0.0).across_m
    assert job["width_m"] in WIDTHS_M and LEAST_WIDTHS * job["width_m"] <= across_m
    assert SPEEDS_KMH[0] <= job["speed_kmh"] <= SPEEDS_KMH[1] and RADII_M[0] <= job["radius_m"] <= RADII_M[1]
    assert job["tractors"] in ([1], [1, 2], [1, 2, 3])
    assert draw_job(seed, PARCELS, exact=True) == job | {"tractors": [1]}
    assert (1 <= len(field.obstacles) <= MAX_OBSTACLES) if seed // 2 % 2 else not field.obstacles
    assert all(field.boundary.contains(one.shape) for one in field.obstacles)
    if seed % 2:
        assert MADE_HA[0] <= field.boundary.area / 1e4 * (1 + 1e-9) and field.boundary.area / 1e4 <= MADE_HA[1] + 1e-9
    else:
        assert field.boundary.equals(next(one.boundary for one in PARCELS if job["name"].endswith(one.name)))


def test_parcels_are_chosen_by_size_and_breadth() -> None:
    sizes = {"small": (40.0, 100.0), "large": (700.0, 600.0), "strip": (8.9, 2000.0), "right": (9.1, 600.0)}
    parcels = [Field(name, shapely.box(0.0, 0.0, *size)) for name, size in sizes.items()]
    assert [one.name for one in choose_parcels([*parcels, *PARCELS])] == ["p1", "p2", "right"]


@pytest.mark.parametrize("radius_m", RADII_M)
def test_tractors_have_the_radius_asked_for(radius_m: float) -> None:
    tractor = build_tractor(radius_m)
    assert tractor.wheelbase_m / math.tan(math.radians(tractor.max_steering_deg)) == pytest.approx(radius_m, rel=0.05)


def build_row(name: str, worked_pct: float | None, time_s: float, cpu_s: float, **more: Any) -> dict[str, Any]:
    answer = build_lost_answer("") | {"crash": None, "worked_pct": worked_pct, "time_s": time_s, "cpu_s": cpu_s}
    costs = {"wall_s": 0.5 * cpu_s, "peak_mb": 200.0, "body_outside_m": 0.1, "over_finished_m2": 50.0, "tractors": 1}
    asked = {"name": name, "ha": 3.6, "width_m": 10.0, "speed_kmh": 3.6, "radius_m": 5.0, "asked": [1], "obstacles": 0}
    return asked | answer | costs | more


def test_the_report_counts_as_by_hand() -> None:
    """Ratios for equal ground: 900/90 by 1000/100 is 1; 1100/100 by 1000/100 is 1.1."""
    rows = [
        build_row("a", 90.0, 900.0, 8.0, base=build_row("a", 100.0, 1000.0, 4.0)),
        build_row("b", 100.0, 1100.0, 2.0, base=build_row("b", 100.0, 1000.0, 4.0, over_finished_m2=10.0)),
        build_row("c", None, 0.0, 1.0, refused="Too wide.", base=build_row("c", 50.0, 10.0, 2.0, remark="said")),
        build_row("d", None, 0.0, 9.0, crash="no answer", base=build_row("d", None, 0.0, 9.0, refused="No.")),
    ]
    lines = list(report(rows))
    base = lines.index("base:")
    assert lines[0] == "4 jobs: 2 planned, 1 refused (slowest after 0.5 s), 1 lost"
    assert lines[1:3] == ["  c: Too wide.", "  d: no answer"]
    assert "CPU s: median 5.0, worst 9.0 (d)" in lines and "wall s: median 2.5, worst 4.5 (d)" in lines
    assert "worked: median 95.00 %, tenth 90.00 %, lowest 90.00 % (a)" in lines
    assert "worked below 95 % without a remark: 1 a" in lines
    assert "over finished ground: 100 m2 in all" in lines
    assert "  worked below 95 % without a remark: 0" in lines[base:]
    assert "planned here only: 0" in lines and "planned by the base only: 1 c" in lines
    assert "finish for equal ground against base: median 1.050, worst 1.100 (b); more than 5 % later: 1" in lines
    assert "over finished ground, planned by both: 100 m2, base 60" in lines
    assert "CPU s against base: median 0.750, worst 2.000 (a)" in lines


def test_time_over_and_tenth_worst_by_hand() -> None:
    """3.6 ha at 10 m and 1 m/s are 3600 s for one tractor, 1800 s for two; of twenty values the second largest."""
    row = build_row("a", 100.0, 5400.0, 1.0)
    assert compute_time_over(row, row) == pytest.approx(1.5)
    assert compute_time_over(row, row | {"tractors": 2, "worked_pct": 50.0}) == pytest.approx(6.0)
    assert find_tenth_worst([float(value) for value in range(20)]) == 18.0
    assert find_tenth_worst([3.0, 1.0]) == 3.0


def test_a_run_goes_on_from_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is in the file is not planned again, unless it was asked otherwise or has no base."""
    planned: list[tuple[str, Path]] = []

    def note_job(job: dict[str, Any], checkout: Path) -> dict[str, Any]:
        planned.append((job["name"], checkout))
        return build_lost_answer(f"{len(planned)}")

    monkeypatch.setattr("tests.benchmarks.answers.plan_apart", note_job)
    monkeypatch.setattr("tests.benchmarks.answers.compile_checkout", lambda checkout: None)
    jobs, out = [draw_job(seed, PARCELS) for seed in (1, 2)], tmp_path / "rows.jsonl"
    first = list(iter_rows(jobs[:1], None, out))
    again = list(iter_rows(jobs, None, out))
    assert again[0] == first[0] and len(planned) == 2
    assert [row["base"]["crash"] for row in iter_rows(jobs, tmp_path, out)] == ["4", "6"]
    assert planned[2:4] == [(jobs[0]["name"], ROOT), (jobs[0]["name"], tmp_path)]
    list(iter_rows([draw_job(1, PARCELS, exact=True) | {"tractors": [5]}], None, out))
    assert len(planned) == 7 and list(read_rows(out)) == [job["name"] for job in jobs]


def test_a_job_that_takes_too_long_is_ended_and_one_of_another_checkout_is_not_taken(tmp_path: Path) -> None:
    """A checkout without sources cannot answer: nothing but its own `planner` is used."""
    assert plan_apart(draw_job(1, PARCELS), ROOT, limit_s=0.01)["crash"] == "no answer in 0 s of CPU"
    assert "planner" in plan_apart(draw_job(1, PARCELS), tmp_path)["crash"]


def test_a_job_ends_with_the_process_that_started_it() -> None:
    """Also where that is killed and can tidy nothing up."""
    code = "from tests.benchmarks import growth as g; g.plan_apart(g.build_sized_job('hectares', 500, (1, 2)), g.ROOT)"
    starter = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)})
    children = Path(f"/proc/{starter.pid}/task/{starter.pid}/children")
    started = wait_for(lambda: [int(pid) for pid in children.read_text().split()])
    assert len(started) == 1 and wait_for(lambda: measure_session_cpu_s(started[0]) > 1.0)
    starter.kill()
    starter.wait()
    assert wait_for(lambda: measure_session_cpu_s(started[0]) == 0.0)


def wait_for(find: Callable[[], T], longest_s: float = 60.0) -> T:
    """What a function finds as soon as it finds something; what it found last after so many seconds."""
    begun = time.monotonic()
    while not (found := find()) and time.monotonic() - begun < longest_s:
        time.sleep(0.1)
    return found


def test_exponents_are_those_of_the_upper_half() -> None:
    """Cost grows with size to the power 1.5 from 10 on, and is flat before; a size of 0 has no logarithm."""
    costs = {0: 1.0, 1: 10.0**1.5, 2: 10.0**1.5, 10: 10.0**1.5, 20: 20.0**1.5, 50: 50.0**1.5}
    assert fit_exponent(costs) == pytest.approx(1.5)
    assert fit_exponent({0: 1.0, 5: 2.0}) is None


def test_sizes_are_as_asked_and_obstacles_nest() -> None:
    assert choose_sizes("hectares", 20) == [1, 2, 5, 10, 20] and choose_sizes("obstacles", 0) == []
    assert build_outline(7.0).area == pytest.approx(7e4)
    few, many = draw_points(10), draw_points(200)
    assert len(many) == 200 and many[:10] == few
    assert all(build_outline(20.0).contains(one.shape) for one in many)
    assert build_sized_job("tractors", 5, (1, 2))["tractors"] == [5]
    assert build_sized_job("hectares", 5, (1, 2))["tractors"] == [1, 2]
