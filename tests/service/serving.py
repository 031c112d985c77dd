"""A service with the kinds of jobs of these tests, as a process to be killed.

    python -m tests.service.serving DATA DATABASE WORKERS whole|workers

With "workers" it has no network: workers and who looks after them alone.
"""

import signal
import sys
import threading
from pathlib import Path

from planner.commands.serve import _run
from planner.service.jobs.supervisor import Supervisor
from planner.service.settings import Settings
from planner.service.store import Store
from tests.benchmarks.jobs import LEASE_S
from tests.service.kinds import KINDS


def main() -> None:
    data, database, workers, how = sys.argv[1:]
    settings = Settings(
        data=Path(data), database=database, port=0, workers=int(workers), lease_s=LEASE_S, kinds=dict(KINDS)
    )
    if how == "whole":
        _run(settings)
        return
    supervisor, over = Supervisor(settings, Store(settings)), threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: over.set())
    supervisor.start()
    over.wait()
    supervisor.stop()


if __name__ == "__main__":
    main()
