"""Processes that take tasks: clean ones, that end with whoever started them; and executors of other makes."""

import multiprocessing
import multiprocessing.context
import os
import re
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

import planner.pipeline.worker_tasks
from planner.errors import HeadlandError, WorkerError
from planner.evaluation.candidates.evaluate import Candidate
from planner.pipeline.executors import LocalPool, SerialExecutor, create_executor, iter_completed

ROOT = Path(__file__).parents[2]
needs_signals = pytest.mark.skipif(os.name != "posix", reason="needs signals and groups of processes")

SCRIPT = """
import json, sys, threading
from planner import PlanRequest, plan


field = {"type": "Polygon", "coordinates": [[[0, 0], [40, 0], [40, 70], [0, 70], [0, 0]]]}
with open("field.geojson", "w") as file:
    json.dump(field, file)
question = PlanRequest("field.geojson", local=True, tractors=(1, 2), strategies=("split-field", "interleaved"))
answers = []
threads = [threading.Thread(target=lambda: answers.append(plan(question).ranking.best)) for _ in range(2)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
assert len(answers) == 2 and answers[0] == answers[1] is not None
print("once")
"""


@pytest.fixture(scope="module")
def pool() -> Iterator[LocalPool]:
    """Two processes."""
    with LocalPool(2) as executor:
        yield executor


@pytest.fixture(scope="module")
def helper() -> Iterator[LocalPool]:
    """One process, which has begun."""
    with LocalPool(1) as executor:
        executor.submit(os.getpid).result(240)
        yield executor


class TestCompleted:
    @pytest.mark.parametrize("make", [SerialExecutor, lambda: ThreadPoolExecutor(3)])
    def test_each_once_with_its_index(self, make: Any) -> None:
        with make() as executor:
            assert sorted(iter_completed(executor, pow, [(2, k) for k in range(5)])) == [(k, 2**k) for k in range(5)]

    def test_as_they_are_done_and_not_as_they_are_listed(self) -> None:
        first = threading.Event()
        with ThreadPoolExecutor(2) as executor:
            order = []
            for index, _ in iter_completed(
                executor, lambda wait: first.wait(60) if wait else True, [(True,), (False,)]
            ):
                order.append(index)
                first.set()
        assert order == [1, 0]

    def test_serial_results_come_one_by_one(self) -> None:
        done: list[int] = []
        results = iter_completed(SerialExecutor(), done.append, [(k,) for k in range(3)])
        next(results)
        assert done == [0]

    def test_an_error_is_raised_and_the_rest_is_not_begun(self) -> None:
        done: list[int] = []

        def task(number: int) -> None:
            done.append(1 // number)

        with pytest.raises(ZeroDivisionError):
            list(iter_completed(SerialExecutor(), task, [(1,), (0,), (1,)]))
        assert done == [1]


class TestLocalPool:
    @pytest.mark.slow
    def test_results_and_errors_come_back(self, pool: LocalPool) -> None:
        assert [future.result(240) for future in [pool.submit(divmod, n, 7) for n in range(20)]] == [
            divmod(n, 7) for n in range(20)
        ]
        with pytest.raises(ZeroDivisionError):
            pool.submit(divmod, 1, 0).result(240)

    @pytest.mark.slow
    def test_processes_are_others_and_not_forked(self, pool: LocalPool, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(sys, "here_only", True, raising=False)
        with LocalPool(1) as fresh:
            number = fresh.submit(os.getpid).result(240)
            known = fresh.submit(eval, "hasattr(__import__('sys'), 'here_only')").result(240)
        assert number != os.getpid() and known is False

    @pytest.mark.slow
    def test_a_lost_process_is_told(self) -> None:
        with LocalPool(1) as executor, pytest.raises(BrokenExecutor):
            executor.submit(os._exit, 3).result(240)

    @pytest.mark.parametrize("error", [BrokenPipeError, BlockingIOError])
    def test_a_process_that_cannot_be_started_is_lost(
        self, error: type[OSError], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def broken(*_: Any) -> None:
            raise error

        monkeypatch.setattr(multiprocessing.context.SpawnProcess, "_Popen", broken)
        with pytest.raises(BrokenExecutor, match="could not be started"), LocalPool(1):
            pass
        with pytest.raises(WorkerError, match=r"could not be started.* fewer .processes"):
            create_executor(2, 2)

    @pytest.mark.slow
    def test_the_caller_helps(self, pool: LocalPool) -> None:
        hands = {process for _, process in iter_completed(pool, busy, [(0.05,)] * 40)}
        assert os.getpid() in hands and len(hands) > 1

    @pytest.mark.slow
    def test_what_is_finished_while_the_last_result_is_looked_at_is_not_lost(self, pool: LocalPool) -> None:
        found = []
        for index, _ in iter_completed(pool, busy, [(0.01,), (0.3,)]):
            found.append(index)
            time.sleep(1.0)
        assert sorted(found) == [0, 1]

    @pytest.mark.slow
    def test_no_process_holds_a_task_that_the_caller_could_do(self, helper: LocalPool) -> None:
        """Two tasks for two: each has one, though the caller is asked last."""
        hands = [process for _, process in iter_completed(helper, busy, [(1.0,)] * 2)]
        assert sorted(hands) == sorted({os.getpid(), *hands}) and len(hands) == 2

    @pytest.mark.slow
    def test_a_process_goes_on_while_the_caller_is_at_work(self, helper: LocalPool) -> None:
        tasks = [(0.1,)] * 5 + [(3.0,)]
        found = dict(iter_completed(helper, busy, tasks, from_both_ends=True))
        assert [index for index, process in sorted(found.items()) if process == os.getpid()] == [5]

    @pytest.mark.slow
    def test_a_process_lost_among_many_tasks_is_told(self) -> None:
        with LocalPool(1) as executor, pytest.raises(WorkerError, match="processes"):
            list(iter_completed(executor, end_process, [(os.getpid(),)] * 8))

    @pytest.mark.slow
    def test_leaving_by_an_error_ends_what_is_under_way(self) -> None:
        began = time.monotonic()
        with pytest.raises(KeyError), LocalPool(1) as executor:
            executor.submit(os.getpid).result(240)
            executor.submit(time.sleep, 600)
            raise KeyError
        assert time.monotonic() - began < 300

    @pytest.mark.slow
    @pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux")
    def test_processes_are_deaf_to_interrupts_from_their_first_moment(self) -> None:
        with LocalPool(1) as executor:
            (process,) = executor._processes
            heard = int(re.search(r"SigBlk:\s*(\w+)", Path(f"/proc/{process}/status").read_text())[1], 16)
        assert heard >> (signal.SIGINT - 1) & 1

    def test_an_interrupt_ends_the_caller_with_large_tasks_not_yet_handed_over(self, tmp_path: Path) -> None:
        script = tmp_path / "script.py"
        (tmp_path / "waiting.py").write_text(
            "import multiprocessing, time\n"
            "def wait(load):\n"
            "    time.sleep(0.05)\n"
            "    if multiprocessing.parent_process() is None:\n"
            "        raise KeyboardInterrupt\n"
        )
        script.write_text(
            "from planner.pipeline.executors import LocalPool, iter_completed\nfrom waiting import wait\n"
            "with LocalPool(2) as pool:\n"
            "    list(iter_completed(pool, wait, [(bytes(10**7),)] * 40))\n"
        )
        run = subprocess.run([sys.executable, script], cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)},
                             capture_output=True, text=True, timeout=240)  # fmt: skip
        # A tracker of resources, a process of its own, may have the last word.
        assert "KeyboardInterrupt" in run.stderr.splitlines() and "Exception in thread" not in run.stderr


def end_process(caller: int) -> None:
    """End every process but that of the caller."""
    if os.getpid() != caller:
        os._exit(3)


def busy(seconds: float) -> int:
    """The process that took this time."""
    time.sleep(seconds)
    return os.getpid()


@pytest.mark.parametrize(("tasks", "processes", "workers"), [(1, None, None), (5, 1, None), (5, 3, 2), (2, 8, 1)])
def test_the_caller_counts_as_a_process(
    monkeypatch: pytest.MonkeyPatch, tasks: int, processes: int | None, workers: int | None
) -> None:
    monkeypatch.setattr(LocalPool, "submit", lambda *_: None)  # with which processes start
    with create_executor(tasks, processes) as executor:
        if workers is None:
            assert isinstance(executor, SerialExecutor)
        else:
            assert isinstance(executor, LocalPool) and executor.processes == workers


def alive(process: int) -> bool:
    """Whether a process exists and is not merely waiting to be collected."""
    try:
        os.kill(process, 0)
        state = Path(f"/proc/{process}/stat")
        return not state.exists() or state.read_text().rpartition(")")[2].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False


@pytest.mark.slow
@needs_signals
@pytest.mark.parametrize("how", [signal.SIGKILL, pytest.param(signal.SIGTERM, marks=pytest.mark.matrix)])
def test_no_process_outlives_the_one_that_started_it(how: signal.Signals) -> None:
    code = """
        import os, sys, time
        from planner.pipeline.executors import LocalPool
        pool = LocalPool(2)
        numbers = set()
        while len(numbers) < 2:
            numbers |= {name.result() for name in [pool.submit(os.getpid) for _ in range(8)]}
        print(*numbers, flush=True)
        for _ in range(2):
            pool.submit(time.sleep, 600)
        time.sleep(600)
    """
    with subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(code)], stdout=subprocess.PIPE, text=True, cwd=ROOT
    ) as parent:
        workers = [int(word) for word in parent.stdout.readline().split()]
        assert len(workers) == 2 and all(alive(worker) for worker in workers)
        parent.send_signal(how)
        parent.wait(240)
        deadline = time.monotonic() + 240
        while any(alive(worker) for worker in workers) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert not any(alive(worker) for worker in workers)


@pytest.mark.matrix
def test_a_script_may_plan_from_threads(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-W", "error", str(script)], cwd=tmp_path, capture_output=True, text=True, timeout=300,
        env=environment, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout == "once\n"


@pytest.mark.slow
def test_a_lost_process_refuses_the_plan_in_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planner.pipeline.worker_tasks, "evaluate_task", lose_the_process)
    words = r"ended or could not be started.* fewer .processes."
    with pytest.raises(HeadlandError, match=words) as refusal, LocalPool(1) as executor:
        list(planner.pipeline.worker_tasks.iter_outcomes(executor, b"", [Candidate("split-field", 1)] * 9))
    assert refusal.value.parameter == "processes" and refusal.value.status == 1


def lose_the_process(*_: Any) -> list[Any]:
    """End the process without a word, but not the one that runs the tests."""
    if multiprocessing.parent_process() is not None:
        os._exit(3)
    time.sleep(0.05)
    return []
