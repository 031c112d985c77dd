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
WORK_FOLDER = "work"  # of jobs and readings, in the data folder
MEGABYTE_BYTES = 2**20
HIGHEST_PORT = 65_535
CONNECT_TIMEOUT_S = 5.0  # of connections to other processes and machines; databases have their own
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

    `database` is a URL of SQLAlchemy, "" for an SQLite file in the folder `data`. `results` is the address of a store
    by which results come from workers on other machines, "" for the database. `workers` jobs run at a time, with
    `processes` each, and `jobs_waiting` of each token may wait. A job whose worker does not report for `lease_s` is
    given to another, and fails after `tries` attempts. Files and results that would leave less than `reserve_mb` free
    on the disk are refused. `public_url` is the address for browsers behind a proxy, "" without one. `job_functions`
    adds kinds of jobs by name (planner.service.jobs.input_files.JobFunction). `video_hosts` are those that pages may
    load video from, each with its scheme. `background` is that of maps: "" for none, an address with {z}, {x} and {y},
    or an .mbtiles or .tif file; `background_attribution` says whose it is. Tiles of an address exist up to
    `background_zoom`, and at most `background_cache_mb` of them are kept in `data`. Raises ServiceError.
    """

    data: Path = field(default_factory=find_default_data)
    database: str = ""
    results: str = ""
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
        try:
            return self.host == "localhost" or ipaddress.ip_address(self.host.strip("[]")).is_loopback
        except ValueError:
            return False

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


@dataclass(frozen=True)
class Limits:
    """Limits that keep one client, file or link from taking what all need; those that a farm chooses are settings.

    Names end in the unit, else they count; reasons stand beside them.
    """

    # access
    most_logins: int = 100  # browsers that stay logged in
    login_valid_s: float = 30 * 24 * 3600.0
    view_valid_s: float = 60.0  # a frame asks for its view at once
    most_views: int = 1000  # that nobody has looked at yet
    longest_token_chars: int = 200  # longer texts are not looked up
    # connections and requests
    most_requests_per_client: int = 32  # forwarded at a time
    most_requests: int = 256
    response_timeout_s: float = 300.0
    uploads_at_a_time: int = 4  # largest uploads that the budget of bodies has room for
    share_of_client: float = 0.5  # of that budget: two of them
    report_period_s: float = 60.0  # between two lines of the log on closed connections
    reserved_files: int = 256  # descriptors kept back for links, the database and files
    most_tracked_keys: int = 10_000  # addresses whose rates are known
    fewest_per_turn: int = 1  # requests admitted while the event loop is late
    late_turn_s: float = 0.010  # a turn that is later than this shows an overloaded event loop
    most_urgent_per_s: float = 20.0  # requests of an operator that skip the queue
    most_head_bytes: int = 64 * 1024
    most_control_frames_per_s: int = 50  # pings and fragments of one link
    most_unsent_bytes: int = 2**18  # that the other end of a link has not taken yet
    parse_slice_bytes: int = 8 * 1024  # of a link, parsed at a time
    parse_pause_s: float = 0.002  # between two slices
    close_timeout_s: float = 1.0  # in which a link must answer a close frame
    most_frame_bytes: int = 2**18
    backlog: int = 1024  # connections that wait to be accepted
    accepts_per_turn: int = 32  # of them, by uvicorn in a turn of the event loop
    shutdown_s: int = 5  # for requests that are under way
    sweep_period_s: float = 3600.0  # between two searches for bytes that nothing names
    job_count_period_s: float = 5.0  # between two counts of jobs for metrics
    largest_event_id: int = 2**53  # JavaScript has no larger whole numbers
    # log lines
    repeat_period_s: float = 60.0
    most_repeats: int = 5  # of one message in that time
    most_tracked_messages: int = 500
    longest_message_chars: int = 2000
    # texts and lists in requests
    longest_text_chars: int = 400
    most_list_entries: int = 64
    most_toml_chars: int = 400_000  # of a day file
    most_form_chars: int = 100_000
    most_changes: int = 50  # of a form at a time
    longest_value_chars: int = 1000  # of a form
    longest_plan_chars: int = 30_000_000
    most_origin_chars: int = 1000  # hosts of video: answers name each twice, and proxies may refuse headers of 4 kB
    # files and jobs
    read_slots: int = 4  # readings at a time
    most_waiting: int = 200  # readings of all clients
    longest_read_s: float = 60.0  # of any file, and of the check of a request
    shortest_read_s: float = 10.0  # limit for up to a megabyte
    read_s_per_megabyte: float = 5.0  # more for every further one
    least_memory_bytes: int = 512 * 2**20  # of one reading
    most_memory_bytes: int = 2 * 2**30
    most_cached_summaries: int = 100
    most_listed_jobs: int = 500
    most_manifest_bytes: int = 64 * 2**20
    longest_life_days: int = 3660  # of a token
    # fleets and links
    most_fleets: int = 20  # live ones
    most_links_per_token: int = 50  # besides those of tractors
    most_links: int = 200  # viewers among them wait for one to end
    end_timeout_s: float = 20.0  # for which a stopping service waits for its database
    work_attempts: int = 2  # where the process of a long computation is killed
    longest_connect_chars: int = 4096
    frames_in_a_row: int = 20  # of one client, after which others have their turn
    shown_corrections: int = 600  # ten minutes
    # backgrounds of maps
    most_pixels_per_tile: int = 2**26  # of a GeoTIFF without overviews; more would take too long
    most_side_px: int = 1024  # of a tile
    most_address_chars: int = 1_000
    kept_share: float = 0.9  # of the limit of tiles after some were deleted, so that this is not done for every tile
    queue_timeout_s: float = 30.0  # for a tile, with the wait for others
    most_fetches: int = 4  # of tiles at a time
    fresh_s: float = 30 * 86_400.0  # until a kept tile is fetched again
    most_remembered: int = 5_000  # tiles that could not be had


LIMITS = Limits()
