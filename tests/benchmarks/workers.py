"""Workers on other machines: plans per minute of one and of several, what taking a job costs, and jobs under faults.

    python -m tests.benchmarks.workers --workers 1,2 --jobs 12
    python -m tests.benchmarks.workers --workers 1,4 --jobs 8 --share 0.2
    python -m tests.benchmarks.workers --faults-only --jobs 60 --kill-every 10

A PostgreSQL of its own is started. Each worker is held to a core of its own as long as there are enough, or to a share
of one, and the jobs are plans of a small field, so many for each worker. Then workers are killed one after the other
and the database is restarted, while jobs of a second each are done. Needs the programs of PostgreSQL and the
`sched_setaffinity` of Linux.
"""

import argparse
import os
import resource
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, nullcontext
from dataclasses import replace
from datetime import datetime
from pathlib import Path

from planner.service.settings import ServiceSettings
from planner.service.store.carried_bytes import RemoteStore
from planner.service.store.job_queue import DONE, UNFINISHED_STATUSES
from planner.service.store.service_store import Store
from planner.service.store.tables import JobRow, Owner
from tests.benchmarks.core_share import hold_to_share, take_turns
from tests.service.kinds import made

ROOT = Path(__file__).parents[2]
PLAN = {"field": "denmark", "width": 6.0, "tractors": "1"}
STEP_S, PATIENCE_S, TAKEN_JOBS = 0.25, 900.0, 200
CLI = (sys.executable, "-c", "from planner.cli.main import main\nif __name__ == '__main__':\n    main()")


class OwnServer:
    """A PostgreSQL in a folder, on a free port, for as long as it is open."""

    def __init__(self, folder: Path) -> None:
        programs = sorted(Path("/usr/lib/postgresql").glob("*/bin/pg_ctl"))
        self._control = str(programs[-1]) if programs else "pg_ctl"
        self._as_user: tuple[str, ...] = ()
        if os.geteuid() == 0:  # the server refuses root
            self._as_user = ("runuser", "-u", "postgres", "--")
            subprocess.run(("chown", "-R", "postgres", folder), check=True)
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        self._data = str(folder / "database")
        self.url = f"postgresql://postgres@127.0.0.1:{port}/postgres"
        self._run("initdb", "-o", "-U postgres -A trust")
        options = f"-p {port} -c listen_addresses=127.0.0.1 -c unix_socket_directories={folder}"
        self._run("start", "-w", "-o", options, "-l", str(folder / "log"))

    def restart(self) -> None:
        """Restart the server; whoever is connected is disconnected."""
        self._run("restart", "-w", "-m", "fast")

    def close(self) -> None:
        """End the server."""
        self._run("stop", "-m", "immediate")

    def _run(self, *words: str) -> None:
        command = (*self._as_user, self._control, words[0], "-D", self._data, *words[1:])
        subprocess.run(command, check=True, cwd="/", stdout=subprocess.DEVNULL)


def start_on_core(command: Sequence[str], core: int | None) -> subprocess.Popen[bytes]:
    """Start a process that may use one core only, or any, and leads a group of its own."""
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    cores = os.sched_getaffinity(0) if core is None else {core}
    hold: Callable[[], None] = lambda: os.sched_setaffinity(0, cores)  # noqa: E731
    return subprocess.Popen(
        command, env=environment, cwd=ROOT, stdout=subprocess.DEVNULL, preexec_fn=hold, start_new_session=True
    )


@contextmanager
def run_workers(commands: list[list[str]]) -> Iterator[list[subprocess.Popen[bytes]]]:
    """One process per command, each on a core of its own while there are enough."""
    cores = sorted(os.sched_getaffinity(0))
    processes = [start_on_core(command, cores[place % len(cores)]) for place, command in enumerate(commands)]
    try:
        yield processes
    finally:
        end_all(processes)


@contextmanager
def run_shares(commands: list[list[str]], share: float) -> Iterator[str]:
    """A process per command, each held to a share of a core; what holds them."""
    with ExitStack() as groups:
        words = [groups.enter_context(hold_to_share(share)) for _ in commands]
        processes = [start_on_core([*each, *command], None) for each, command in zip(words, commands, strict=True)]
        try:
            with nullcontext() if all(words) else take_turns(processes, share):
                yield "control groups" if all(words) else "stopping and continuing them"
        finally:
            end_all(processes)


def end_all(processes: Sequence[subprocess.Popen[bytes]]) -> None:
    """End workers and wait for them."""
    for process in processes:
        process.send_signal(signal.SIGTERM)
    for process in processes:
        process.wait(60)


def wait_until_over(store: Store, ids: set[str]) -> list[JobRow]:
    """The jobs once all are over; what the service does meanwhile is done here."""
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        store.tend_queue()
        jobs = [job for job in store.list_jobs() if job.id in ids]
        if all(job.status not in UNFINISHED_STATUSES for job in jobs):
            return jobs
        time.sleep(0.5)
    raise TimeoutError("the jobs were not done in time")


def measure_plans(store: Store, workers: int, jobs: int, share: float | None) -> tuple[float, str]:
    """Plans per minute of so many workers once they are warm, and a line that says so; `share` of a core for each."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    owners = [Owner(name, name) for name in ("ann", "bob", "eve")]
    ids = {store.add_job("plan", f"plan {n}", PLAN, owner=owners[n % len(owners)]).id for n in range(jobs)}
    command = [*CLI, "worker", "--database", store.settings.database, "--workers", "1"]
    commands = [command] * workers
    with run_workers(commands) if share is None else run_shares(commands, share) as held:
        done = wait_until_over(store, ids)
    if failed := [job.error for job in done if job.status != DONE]:
        raise RuntimeError(f"{len(failed)} plans failed: {failed[0]}")
    ends = sorted(datetime.fromisoformat(str(job.finished)).timestamp() for job in done)[2 * workers - 1 :]
    per_minute = 60.0 * (len(ends) - 1) / (ends[-1] - ends[0])
    now = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = (now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime) / jobs
    size_kb = statistics.mean(sum(result.size for result in job.results) for job in done) / 1000.0
    return per_minute, (
        f"{workers} workers{'' if share is None else f', each held to {share:g} of a core by {held}'}: "
        f"{per_minute:.2f} plans a minute; {cpu_s:.2f} s of CPU a plan with starting, peak memory "
        f"{now.ru_maxrss / 1024:.0f} MB, results {size_kb:.0f} kB a plan"
    )


def measure_taking(store: Store) -> str:
    """What adding, taking, reporting and finishing a job costs without its work, with results as of a plan."""
    content = os.urandom(500_000)
    files = [(f"{n}.json", content[n * 100_000 : (n + 1) * 100_000], "application/json") for n in range(5)]
    with tempfile.TemporaryDirectory() as folder, closing(RemoteStore(replace_folder(store, folder))) as remote:
        for number in range(TAKEN_JOBS):
            store.add_job("tiny", f"job {number}", {}, owner=Owner(str(number % 10), str(number % 10)))
        times_ms: dict[str, list[float]] = {"taking": [], "reporting": [], "finishing with 500 kB": []}
        for _ in range(TAKEN_JOBS):
            started = time.perf_counter()
            job = remote.claim_job("w")
            assert job is not None
            taken = time.perf_counter()
            remote.report_job(job.number, "w", (1, 2, "At work"))
            reported = time.perf_counter()
            remote.finish_job(job.number, "w", files)
            for name, since, until in zip(
                times_ms, (started, taken, reported), (taken, reported, time.perf_counter()), strict=True
            ):
                times_ms[name].append(1000.0 * (until - since))
    parts = [f"{name} {statistics.median(each):.1f} ms" for name, each in times_ms.items()]
    return f"a job besides its work (median of {TAKEN_JOBS}, up to {TAKEN_JOBS} waiting): {', '.join(parts)}"


def replace_folder(store: Store, folder: str) -> ServiceSettings:
    """The settings of a worker of the service elsewhere."""
    return replace(store.settings, data=Path(folder))


def measure_faults(store: Store, server: OwnServer, jobs: int, workers: int, kill_every_s: float) -> str:
    """Do jobs of a second each while a worker is killed from time to time and the database is restarted once."""
    x = store.blobs.put_bytes(b" and a file")
    request = {"step_s": STEP_S, "files": ["x"]}
    ids = [store.add_job("tiny", f"job {n}", {"number": n} | request, {"x": x}).id for n in range(jobs)]
    serving, database = [sys.executable, "-m", "tests.service.serving"], store.settings.database
    folders = [tempfile.mkdtemp() for _ in range(workers)]
    commands = [[*serving, folder, database, "1", "remote"] for folder in folders]
    service = [*serving, str(store.settings.data), database, "0", "workers"]
    kills, restarts, begun_s, cores = 0, 0, time.monotonic(), sorted(os.sched_getaffinity(0))
    with run_workers([service]), run_workers(commands) as processes:
        while any(job.status in UNFINISHED_STATUSES for job in list_patiently(store)):
            if time.monotonic() - begun_s > (kills + 1) * kill_every_s:
                place = kills % workers
                processes[place].kill()
                processes[place].wait()
                processes[place] = start_on_core(commands[place], cores[place % len(cores)])
                kills += 1
            if kills == 2 and not restarts:
                server.restart()
                restarts += 1
            time.sleep(0.2)
    took_s = time.monotonic() - begun_s
    store.fetch_results()
    rows = [store.get_job(id) for id in ids]
    right = sum(
        job.status == DONE and [store.blobs.read_bytes(each.sha256) for each in job.results] == [content]
        for number, job in enumerate(rows)
        for _, content, _ in made(number, b" and a file")
    )
    return (
        f"{right} of {jobs} jobs done once with the right bytes by {workers} workers in {took_s:.0f} s, "
        f"{sum(job.tries for job in rows)} times begun; {kills} workers killed, the database restarted {restarts} times"
    )


def list_patiently(store: Store) -> list[JobRow]:
    """The jobs of a second each; a database that is being restarted is waited for."""
    until = time.monotonic() + 30.0
    while True:
        try:
            return store.list_jobs("tiny")
        except Exception:
            if time.monotonic() > until:
                raise
            time.sleep(0.5)


def main() -> None:
    """Print what was measured."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--workers", default="1,2")
    parser.add_argument("--jobs", type=int, default=12)
    parser.add_argument("--share", type=float)
    parser.add_argument("--kill-every", type=float, default=10.0)
    parser.add_argument("--faults-only", action="store_true")
    given = parser.parse_args()
    counts = [int(each) for each in given.workers.split(",")]
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}", flush=True)
    with (
        tempfile.TemporaryDirectory() as own,
        tempfile.TemporaryDirectory() as data,
        closing(OwnServer(Path(own))) as server,
    ):
        Path(own).chmod(0o755)
        settings = ServiceSettings(
            data=Path(data), database=server.url, workers=0, lease_s=5.0, tries=20, jobs_waiting=10**6
        )
        with closing(Store(settings)) as store:
            store.check_write()
            if not given.faults_only:
                found = []
                for workers in counts:
                    per_minute, line = measure_plans(store, workers, given.jobs * workers, given.share)
                    found.append(per_minute)
                    print(line, flush=True)
                print(f"{counts[-1]} workers do {found[-1] / found[0]:.2f} times the plans of {counts[0]}", flush=True)
                print(measure_taking(store), flush=True)
            print(measure_faults(store, server, given.jobs, counts[-1], given.kill_every))


if __name__ == "__main__":
    main()
