"""Jobs while server and workers are killed at random: each is done once in result, and no process is left over.

    python -m tests.benchmarks.jobs --jobs 100 --kills 10 [--database URL]

A process of its own serves; jobs are put into its store, and kill -9 takes now the server, now one of its workers.
Needs /proc, which tells the processes of a campaign by a mark in their environment.
"""

import argparse
import os
import random
import secrets
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from planner.service.settings import ServiceSettings
from planner.service.store.job_queue import DONE, UNFINISHED_STATUSES
from planner.service.store.service_store import Store
from tests.service.kinds import made

MARK = "HEADLAND_CAMPAIGN"
STEP_S, LEASE_S = 0.03, 2.0


@dataclass
class Campaign:
    """What came of it: done once, done otherwise, processes killed, processes left over, seconds."""

    jobs: int
    done: int = 0
    wrong: list[str] = field(default_factory=list)
    begun: int = 0
    servers_killed: int = 0
    workers_killed: int = 0
    left_over: list[int] = field(default_factory=list)
    took_s: float = 0.0


class Serving:
    """A service in a process of its own, started again where it was killed."""

    def __init__(self, settings: ServiceSettings, whole: bool) -> None:
        self.mark = secrets.token_hex(8)
        self._words = [str(settings.data), settings.database, str(settings.workers), "whole" if whole else "workers"]
        self.process = self._started()

    def _started(self) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "tests.service.serving", *self._words]
        environment = os.environ | {MARK: self.mark}
        return subprocess.Popen(command, env=environment, cwd=Path(__file__).parents[2], stdout=subprocess.DEVNULL)

    def kill(self) -> None:
        """Kill the server, and start it again."""
        self.process.kill()
        self.process.wait()
        self.process = self._started()

    def workers(self) -> list[int]:
        """Workers of the server that are there now."""
        return [pid for pid in self.alive() if parent_of(pid) == self.process.pid and b"spawn_main" in words_of(pid)]

    def alive(self) -> list[int]:
        """Every process of this campaign."""
        mark = f"{MARK}={self.mark}".encode()
        pids = [int(path.name) for path in Path("/proc").iterdir() if path.name.isdecimal()]
        return [pid for pid in pids if mark in content(pid, "environ")]

    def end(self) -> list[int]:
        """End the server; processes that outlive it by more than some seconds."""
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(20)
        until = time.monotonic() + 10.0
        while self.alive() and time.monotonic() < until:
            time.sleep(0.1)
        return self.alive()


def content(pid: int, name: str) -> bytes:
    """A file of a process; nothing where it is gone."""
    try:
        return Path(f"/proc/{pid}/{name}").read_bytes()
    except OSError:
        return b""


def words_of(pid: int) -> bytes:
    """The command of a process."""
    return content(pid, "cmdline")


def parent_of(pid: int) -> int:
    """The process that started another, 0 where it is gone."""
    after = content(pid, "stat").rpartition(b")")[2].split()
    return int(after[1]) if len(after) > 1 else 0


def campaign(
    settings: ServiceSettings, jobs: int, kills: int, seed: int, *, whole: bool, patience_s: float
) -> Campaign:
    """Do so many jobs while so many processes are killed, spread over the work: the server first, then by lot."""
    draw, began = random.Random(seed), time.monotonic()
    store, found = Store(settings), Campaign(jobs)
    shared = store.blobs.put_bytes(b" and a file")
    ids = [
        store.add_job("tiny", f"job {number}", {"number": number, "step_s": STEP_S, "files": ["x"]}, {"x": shared}).id
        for number in range(jobs)
    ]
    serving = Serving(settings, whole)
    try:
        for kill in range(kills):
            _wait(store, ids, round(jobs * (kill + draw.random()) / (kills + 1)), began + patience_s)
            time.sleep(draw.uniform(0.0, 0.3))
            _kill_one(serving, found, draw, server=kill == 0 or draw.random() < 0.5)
        _wait(store, ids, jobs, began + patience_s)
    finally:
        found.left_over = serving.end()
    _count(store, ids, found)
    found.took_s = time.monotonic() - began
    store.close()
    return found


def _wait(store: Store, ids: list[str], done: int, until: float) -> None:
    """Wait until so many are over."""
    while sum(job.status not in UNFINISHED_STATUSES for job in store.list_jobs("tiny") if job.id in set(ids)) < done:
        if time.monotonic() > until:
            raise TimeoutError(f"{done} jobs were not done in time")
        time.sleep(0.1)


def _kill_one(serving: Serving, found: Campaign, draw: random.Random, *, server: bool) -> None:
    workers = serving.workers()
    if server or not workers:
        serving.kill()
        found.servers_killed += 1
        return
    os.kill(draw.choice(workers), signal.SIGKILL)
    found.workers_killed += 1


def _count(store: Store, ids: list[str], found: Campaign) -> None:
    """Which jobs are done once, with the bytes that they should have."""
    for number, id in enumerate(ids):
        job = store.get_job(id)
        results = [(each.name, store.blobs.read_bytes(each.sha256), each.media) for each in job.results]
        wanted = [(name, content, "application/json") for name, content in made(number, b" and a file").items()]
        found.begun += job.tries
        if job.status == DONE and results == wanted:
            found.done += 1
        else:
            found.wrong.append(f"{job.name}: {job.status} {job.error}")


def main() -> None:
    """Print what came of a campaign."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--jobs", type=int, default=100)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--database", default="")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        settings = ServiceSettings(
            data=Path(folder), database=given.database, workers=given.workers, lease_s=LEASE_S, jobs_waiting=given.jobs
        )
        found = campaign(settings, given.jobs, given.kills, given.seed, whole=True, patience_s=600.0)
    print(f"{found.done} of {found.jobs} jobs done once with the right bytes, {found.begun} times begun")
    print(f"{found.servers_killed} servers and {found.workers_killed} workers killed in {found.took_s:.0f} s")
    print(f"{len(found.left_over)} processes left over")
    for each in found.wrong:
        print(f"wrong: {each}")


if __name__ == "__main__":
    main()
