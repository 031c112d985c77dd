"""Writes planner/pipeline/kernels.csv: every compiled function that Python calls in a number of typical runs.

python -m tests.planner.kernel_list        # minutes: everything is compiled again, to time it
"""

import csv
import io
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import planner.pipeline.kernels as kernels
from tests.warm import DRIVES, PLANS

RECORDER = """
import atexit, json, os, sys, time
from planner.pipeline.kernels import format_types
from vehicle import jit

begun, rows = {}, {}
load, save = jit._CheckedCache.load_overload, jit._CheckedCache.save_overload

def load_overload(self, signature, context):
    name = f"{self._py_func.__module__}.{self._py_func.__qualname__}"
    key = name, format_types(signature)
    rows[key], begun[key] = 0.0, time.process_time()
    return load(self, signature, context)

def save_overload(self, signature, result):
    name = f"{self._py_func.__module__}.{self._py_func.__qualname__}"
    key = name, format_types(signature)
    rows[key] = time.process_time() - begun[key]
    save(self, signature, result)

jit._CheckedCache.load_overload, jit._CheckedCache.save_overload = load_overload, save_overload
atexit.register(lambda: open(os.environ["KERNEL_ROWS"], "w").write(json.dumps([[*key, s] for key, s in rows.items()])))
"""
RUN = "import sys\nfrom planner.cli.main import main\nsys.argv = ['headland', *{!r}.split()]\nmain()\n"
PLAN_RUNS = ("plan --processes 1 --json", "plan denmark --tractors 1-2 --strategies split-field --processes 1 --json")


def record(code: str, environment: dict[str, str] | None = None) -> dict[tuple[str, str], float]:
    """The kernels that Python code calls in a process of its own, and the seconds each took to compile, or 0."""
    with tempfile.TemporaryDirectory() as room:
        rows = Path(room) / "rows.json"
        whole = {**os.environ, "KERNEL_ROWS": str(rows), **(environment or {})}
        whole["PYTHONPATH"] = os.pathsep.join(
            [str(Path(__file__).parents[2]), *filter(None, [whole.get("PYTHONPATH")])]
        )
        words = [sys.executable, "-c", RECORDER + code]
        subprocess.run(words, env=whole, cwd=room, stdout=subprocess.DEVNULL, timeout=1800, check=True)
        return {(name, types): seconds for name, types, seconds in json.loads(rows.read_text())}


def write_list() -> None:
    """Record the runs, each with what the ones before have compiled, and write the list."""
    found: dict[tuple[str, str], tuple[str, float]] = {}
    with tempfile.TemporaryDirectory() as kept:
        for use, codes in ((kernels.PLAN, [RUN.format(run) for run in PLAN_RUNS]), (kernels.MORE, [DRIVES, PLANS])):
            for code in codes:
                for key, seconds in record(code, {"NUMBA_CACHE_DIR": kept}).items():
                    found.setdefault(key, (use, seconds))
    rows = [(use != kernels.PLAN, name, types, use, seconds) for (name, types), (use, seconds) in found.items()]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows((use, f"{seconds:.1f}", name, types) for _, name, types, use, seconds in sorted(rows))
    (Path(kernels.__file__).parent / kernels.LIST_FILE).write_text(text.getvalue(), encoding="utf-8")


if __name__ == "__main__":
    write_list()
