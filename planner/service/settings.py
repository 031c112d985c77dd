"""Settings of a service: address, data folder, database and limits."""

from __future__ import annotations

import ipaddress
import os
import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from planner.service.errors import ServiceError

DEFAULT_HOST, DEFAULT_PORT = "127.0.0.1", 8765
DATABASE_FILE = "headland.db"
MEGABYTE_BYTES = 2**20
HIGHEST_PORT = 65_535
PUBLIC_URL = re.compile(r"https?://[^/\s?#@]+")


def find_default_data() -> Path:
    """The default data folder: $HEADLAND_DATA, else a folder among the user's data."""
    configured = os.environ.get("HEADLAND_DATA")
    if configured:
        return Path(configured)
    base = os.environ.get("LOCALAPPDATA" if os.name == "nt" else "XDG_DATA_HOME")
    return (Path(base) if base else Path.home() / ".local" / "share") / "headland"


def find_version() -> str:
    """The installed version of Headland."""
    try:
        return version("headland")
    except PackageNotFoundError:
        return "unknown"


def count_cores() -> int:
    """Cores of this machine that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True)
class ServiceSettings:
    """Address, data folder and limits of a service.

    `database` is a URL of SQLAlchemy, "" for an SQLite file in the folder `data`. `workers` jobs run at a time, with
    `processes` each, and `jobs_waiting` of each token may wait. A job whose worker does not report for `lease_s` is
    given to another, and fails after `tries` attempts. Files and results that would leave less than `reserve_mb` free
    on the disk are refused. `public_url` is the address for browsers behind a proxy, "" without one. `job_functions`
    adds kinds of jobs by name (planner.service.jobs.job_requests.JobFunction). `video_hosts` are those that pages may
    load video from, each with its scheme. `background` is that of maps: "" for none, an address with {z}, {x} and {y},
    or an .mbtiles or .tif file; `background_attribution` says whose it is. Tiles of an address exist up to
    `background_zoom`, and at most `background_cache_mb` of them are kept in `data`. Raises ServiceError.
    """

    data: Path = field(default_factory=find_default_data)
    database: str = ""
    host: str = DEFAULT_HOST
    port: int = DEFAULT_PORT
    public_url: str = ""
    upload_mb: int = 64
    reserve_mb: int = 50
    jobs_waiting: int = 200
    rate_per_minute: int = 1200
    workers: int = field(default_factory=lambda: 2 if count_cores() > 3 else 1)
    processes: int = field(default_factory=lambda: max(1, count_cores() // (2 if count_cores() > 3 else 1) - 1))
    lease_s: float = 15.0
    tries: int = 3
    job_functions: Mapping[str, object] = field(default_factory=dict)
    video_hosts: tuple[str, ...] = ()
    background: str = ""
    background_attribution: str = ""
    background_zoom: int = 19
    background_cache_mb: int = 200

    def __post_init__(self) -> None:
        if not 0 <= self.port <= HIGHEST_PORT:
            raise ServiceError(f"The port is {self.port}; use 1 to {HIGHEST_PORT}.", parameter="port")
        if not self.host or any(mark in self.host for mark in "/ \t\n"):
            raise ServiceError(f"The host {self.host!r} is not an address; give one such as {DEFAULT_HOST}.")
        if self.public_url and not PUBLIC_URL.fullmatch(self.public_url):
            raise ServiceError(
                f"The public address is {self.public_url[:80]!r}; give only scheme, host and port, such as "
                "https://farm.example.",
                parameter="public_url",
            )

    @property
    def url(self) -> str:
        """The database as a URL of SQLAlchemy."""
        if not self.database:
            return f"sqlite:///{self.data / DATABASE_FILE}"
        for short in ("postgresql://", "postgres://"):
            if self.database.startswith(short):
                return "postgresql+psycopg://" + self.database.removeprefix(short)
        return self.database

    @property
    def is_shared(self) -> bool:
        """Whether workers on other machines can use the database."""
        return self.url.startswith("postgresql")

    @property
    def local(self) -> bool:
        """Whether only this machine can reach the service."""
        return is_loopback(self.host)

    @property
    def is_own_machine(self) -> bool:
        """Whether those who use the service sit at this machine, as far as the settings say: no proxy, this host."""
        return self.local and not self.public_url

    @property
    def data_option(self) -> str:
        """The option that names the folder in commands for the user, " --data FOLDER"; "" for the default folder."""
        return "" if self.data == find_default_data() else f" --data {shlex.quote(str(self.data))}"

    @property
    def upload_bytes(self) -> int:
        """The largest upload, bytes."""
        return self.upload_mb * MEGABYTE_BYTES


def is_loopback(host: str) -> bool:
    """Whether an address is of this machine itself."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False
