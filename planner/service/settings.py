"""What a service is told when it starts."""

from __future__ import annotations

import ipaddress
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from planner.service.errors import ServiceError

DEFAULT_HOST, DEFAULT_PORT = "127.0.0.1", 8765
FILE = "headland.db"
MEGABYTE = 2**20
HIGHEST_PORT = 65_535


def default_data() -> Path:
    """Where a service of this user keeps what it has: $HEADLAND_DATA, else a folder of the user's data."""
    given = os.environ.get("HEADLAND_DATA")
    if given:
        return Path(given)
    base = os.environ.get("LOCALAPPDATA" if os.name == "nt" else "XDG_DATA_HOME")
    return (Path(base) if base else Path.home() / ".local" / "share") / "headland"


def cores() -> int:
    """Cores of this machine."""
    return os.cpu_count() or 1


@dataclass(frozen=True)
class Settings:
    """Where a service listens, keeps what it has, and what it takes at most.

    `database` is a URL of SQLAlchemy, "" for a file of SQLite in the folder `data`. `workers` are jobs at a time,
    `processes` those that one job may use. A job whose worker does not report for `lease_s` is given to another, and
    fails once `tries` were begun. `kinds` names more kinds of jobs, by functions as of planner.service.jobs.work.
    Raises ServiceError.
    """

    data: Path = field(default_factory=default_data)
    database: str = ""
    host: str = DEFAULT_HOST
    port: int = DEFAULT_PORT
    upload_mb: int = 64
    jobs_waiting: int = 200
    rate_per_minute: int = 1200
    workers: int = field(default_factory=lambda: 2 if cores() > 3 else 1)
    processes: int = field(default_factory=lambda: max(1, cores() // (2 if cores() > 3 else 1) - 1))
    lease_s: float = 15.0
    tries: int = 3
    kinds: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 0 <= self.port <= HIGHEST_PORT:
            raise ServiceError(f"The port is {self.port}; use 1 to {HIGHEST_PORT}.", parameter="port")
        if not self.host or any(mark in self.host for mark in "/ \t\n"):
            raise ServiceError(f"The host {self.host!r} is no address; give one such as {DEFAULT_HOST}.")

    @property
    def url(self) -> str:
        """The database as a URL of SQLAlchemy."""
        if not self.database:
            return f"sqlite:///{self.data / FILE}"
        for short in ("postgresql://", "postgres://"):
            if self.database.startswith(short):
                return "postgresql+psycopg://" + self.database.removeprefix(short)
        return self.database

    @property
    def local(self) -> bool:
        """Whether only this machine can reach the service."""
        return is_loopback(self.host)

    @property
    def upload_bytes(self) -> int:
        """The largest file that is taken, bytes."""
        return self.upload_mb * MEGABYTE


def is_loopback(host: str) -> bool:
    """Whether an address is one of this machine itself."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False
