"""A service with the kinds of jobs of these tests, as a process to be killed.

    python -m tests.service.serving DATA DATABASE WORKERS whole|workers|remote

With "workers" it has no network: workers and who looks after them alone. With "remote" it is headland worker.
"""

import signal
import sys
import threading
from pathlib import Path

from planner.cli.server import _run_server
from planner.service.jobs.workers import WorkerSupervisor, run_remote_workers
from planner.service.settings import ServiceSettings
from planner.service.store.service_store import Store
from tests.benchmarks.jobs import LEASE_S
from tests.service.kinds import KINDS


def main() -> None:
    data, database, workers, how = sys.argv[1:]
    settings = ServiceSettings(
        data=Path(data), database=database, port=0, workers=int(workers), lease_s=LEASE_S, job_functions=dict(KINDS)
    )
    if how == "whole":
        _run_server(settings)
        return
    if how == "remote":
        run_remote_workers(settings, lambda: print("at work", flush=True))
        return
    supervisor, over = WorkerSupervisor(settings, Store(settings)), threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: over.set())
    supervisor.start()
    over.wait()
    supervisor.stop()


if __name__ == "__main__":
    main()
