"""The benchmark runs and its variants drive the same; its figures are not judged here."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.benchmarks.bench_loop import WITHOUT_EFFECTS


@pytest.mark.matrix
def test_the_benchmark_runs_at_a_small_size() -> None:
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-m", "tests.benchmarks.bench_loop", "--quick"],
        cwd=root, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    difference = re.search(r"largest difference (\S+)", done.stdout)
    assert difference and float(difference[1]) < 1e-6
    rows = re.findall(
        r"^ +(\d+) +([\d.]+) +([\d.]+) +([\d.]+) +([\d.]+) +([\d.]+) +([\d.]+) +([\d.]+) +([\d.]+)$", done.stdout, re.M
    )
    assert [int(row[0]) for row in rows] == [1, 3]
    assert all(float(value) > 0.0 for row in rows for value in row)
    assert "times plain pymunk, at least" in done.stdout
    assert "of that speed on terrain with a load, at least" in done.stdout
    share = re.search(r"of the speed without effects, +1, at least +0\.80: +([\d.]+) +(met|MISSED)", done.stdout)
    assert share and float(share[1]) == pytest.approx(float(rows[0][6]) / WITHOUT_EFFECTS[1], abs=0.01)
