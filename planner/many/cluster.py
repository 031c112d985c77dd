"""An executor on the machines of a Dask cluster (https://distributed.dask.org), which `headland[cluster]` brings."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from planner.errors import ScenarioError, WorkerError, named

PATIENCE_S = 10.0
TRIES = 3  # a task whose worker is gone is given to others so often


class ClusterError(ScenarioError):
    """A cluster that cannot be used."""


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """The executor of a cluster whose scheduler is at an address, tcp://host:8786.

    Raises ClusterError where there is none, WorkerError where its workers are lost again and again.
    """
    client = _client(address)
    try:
        with client.get_executor(pure=False, retries=TRIES) as executor:
            yield executor
    except Exception as error:
        if type(error).__name__ != "KilledWorker":
            raise
        raise WorkerError(
            f"Workers of the cluster {address} end while they plan, perhaps for want of memory; give each one thread "
            "and 2 GB."
        ) from None
    finally:
        client.close()


def _client(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise ClusterError(
            f"{named('cluster')} needs Dask, which is not installed; install headland[cluster] or leave it out."
        ) from None
    try:
        client = Client(address, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, ValueError):
        raise ClusterError(
            f"There is no Dask scheduler at {address!r} ({named('cluster')}); start one with 'dask scheduler', workers "
            "with 'dask worker ADDRESS --nthreads 1', and give its address, for instance tcp://127.0.0.1:8786."
        ) from None
    if not client.scheduler_info(n_workers=-1)["workers"]:
        client.close()
        raise ClusterError(
            f"The cluster {address} ({named('cluster')}) has no workers; start some with 'dask worker {address}'."
        )
    return client
