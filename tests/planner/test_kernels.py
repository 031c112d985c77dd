"""The list of compiled functions: what it names exists, is shared among processes, and is what plans call."""

import json
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.errors import WorkerError
from planner.pipeline import kernels
from planner.pipeline.kernels import (
    PLAN,
    Kernel,
    compile_kernels,
    format_types,
    parse_types,
    read_kernels,
    share_kernels,
)
from tests.planner.kernel_list import RUN, record

ROOT = Path(__file__).parents[2]
COMPILED = """
import json
from planner.pipeline import kernels

if __name__ == "__main__":
    names = ("find_last_passes", "find_crossed_poses")
    chosen = [one for one in kernels.read_kernels() if one.function.endswith(names)]
    before = sum(one.is_stored() for one in chosen)
    reports = []
    kernels.compile_kernels(chosen, 2, lambda *report: reports.append(report))
    print(json.dumps([len(chosen), before, sum(one.is_stored() for one in chosen), reports]))
"""
FUNCTIONS = st.sampled_from(["a.b.c.f", "a.b.d.g", "a.e.h", "x.y.z", "x.q.r"])
KERNELS = st.lists(st.builds(Kernel, st.just(PLAN), st.floats(0.1, 9.0), FUNCTIONS, st.just("")), max_size=12)


def test_every_row_names_a_function_and_types_that_exist() -> None:
    for kernel in read_kernels():
        types = parse_types(kernel.arguments)
        assert format_types(types) == kernel.arguments
        function = kernel.find_dispatcher().py_func
        most, optional = function.__code__.co_argcount, len(function.__defaults__ or ())
        assert most - optional <= len(types) <= most, kernel.function


def test_where_no_process_starts_this_one_compiles_its_share(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: int) -> None:
        raise WorkerError("No process could be started.")

    shares, compiled = share_kernels(read_kernels(), 2), list[Kernel]()
    monkeypatch.setattr(kernels, "create_executor", refuse)
    monkeypatch.setattr(kernels, "compile_share", compiled.extend)
    compile_kernels(read_kernels(), 2)
    assert compiled == shares[0]


@given(KERNELS, st.integers(1, 5))
def test_processes_share_whole_families(kernels: list[Kernel], processes: int) -> None:
    shares = share_kernels(kernels, processes)
    assert sorted(map(repr, kernels)) == sorted(repr(kernel) for share in shares for kernel in share)
    families = [{kernel.family for kernel in share} for share in shares]
    assert len(shares) <= processes and all(families)
    assert sum(map(len, families)) == len(set().union(*families)), "no family is in two processes"


def test_two_processes_take_half_of_a_plans_functions_each() -> None:
    kernels = [kernel for kernel in read_kernels() if kernel.use == PLAN]
    seconds = [sum(kernel.seconds for kernel in share) for share in share_kernels(kernels, 2)]
    assert max(seconds) < 0.6 * sum(seconds)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["iwamizawa", pytest.param("denmark", marks=pytest.mark.matrix)])
def test_what_a_plan_calls_is_on_the_list(name: str) -> None:
    """Types too; `python -m tests.planner.kernel_list` renews it."""
    listed = {(kernel.function, kernel.arguments) for kernel in read_kernels() if kernel.use == PLAN}
    called = record(RUN.format(f"plan {name} --tractors 1-2 --strategies split-field --processes 1 --json"))
    assert called.keys() <= listed
    assert len(called) > 20


@pytest.mark.slow
def test_two_processes_compile_into_one_cache(tmp_path: Path) -> None:
    (tmp_path / "run.py").write_text(COMPILED)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kept"), "PYTHONPATH": str(ROOT)}
    words = [sys.executable, str(tmp_path / "run.py")]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=300, check=True)
    count, before, after, reports = json.loads(done.stdout)
    assert (count, before, after) == (2, 0, 2)
    assert reports[0] == [0, 2, 0.0]
    assert all(one[0] <= other[0] and one[2] <= other[2] for one, other in pairwise(reports))
