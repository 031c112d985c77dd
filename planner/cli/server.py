"""`headland serve` (the service and its pages), `worker`, `backup`, `restore` and `token` (who may do what)."""

from __future__ import annotations

import gc
import os
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner.cli.common.options import ForceOption, create_group
from planner.cli.common.outputs import check_output_paths, print_written
from planner.cli.common.terminal import compile_apart, limit_linear_algebra_threads
from planner.pipeline.interrupts import stop_repeating

if TYPE_CHECKING:
    import socket
    from contextlib import AbstractContextManager

    from planner.service.access.browsers import BrowserLogins
    from planner.service.settings import ServiceSettings
    from planner.service.store.service_store import Store
    from planner.service.store.tables import TokenRow


DataOption = Annotated[
    Optional[Path],
    typer.Option("--data", help="Folder for all data of the service; by default one in the user's data folder."),
]
DatabaseOption = Annotated[
    str, typer.Option("--database", help="URL of PostgreSQL or SQLite; by default an SQLite file in the data folder.")
]
ResultsOption = Annotated[
    str,
    typer.Option(
        "--results",
        help="Store by which results come from headland worker, such as s3://bucket/folder; else the database.",
    ),
]
BACKGROUND_HELP = (
    "Background of maps: an address such as https://tiles.example/{z}/{x}/{y}.png (XYZ, WMTS; WMS with {bbox}), or an "
    ".mbtiles or .tif file. The service fetches and keeps its tiles; browsers ask nobody else."
)
VIDEO_HELP = (
    "Host that operators may name for video, such as https://gateway.example:8443; may be repeated. The "
    "browsers of all who look load it."
)
WORKERS_HELP = "Jobs that are computed at a time, which share the cores; by default 1, or 2 from four cores."
SERVE_WORKERS_HELP = f"{WORKERS_HELP} 0 leaves all to headland worker."
MOST_WORKERS = 64
SCOPE_HELP = (
    "read; planner (files and jobs); operator (fleets); robot (drives one tractor, with --fleet and --tractor); admin "
    "(everything). May be repeated; robot cannot be combined."
)
EXPIRES_HELP = (
    "When it expires: after 90m, 12h or 30d, after the day 2027-01-31, at 2027-01-31T18:00:00Z, or never. Default: 30d "
    "for a robot, else never."
)


def serve(
    host: Annotated[
        str, typer.Option(help="Address to listen on; addresses other than this machine's need tokens.")
    ] = ("127.0.0.1"),
    port: Annotated[int, typer.Option(help="Port to listen on.")] = 8765,
    data: DataOption = None,
    database: DatabaseOption = "",
    results: ResultsOption = "",
    public_url: Annotated[
        str, typer.Option(help="Address of a proxy in front, as browsers see it, such as https://farm.example")
    ] = "",
    video_host: Annotated[Optional[list[str]], typer.Option(help=VIDEO_HELP)] = None,
    background: Annotated[str, typer.Option(help=BACKGROUND_HELP)] = "",
    background_attribution: Annotated[
        str, typer.Option(help="Whose background it is, shown on every map, such as '© OpenStreetMap contributors'.")
    ] = "",
    background_zoom: Annotated[int, typer.Option(help="Finest zoom that the address has.")] = 19,
    background_cache_mb: Annotated[int, typer.Option(help="Most MB of tiles kept in the data folder.")] = 200,
    workers: Annotated[Optional[int], typer.Option(help=SERVE_WORKERS_HELP)] = None,
) -> None:
    """Plan, watch and drive fleets in a browser; prints the address to open.

    Example: headland serve --data farm
    """
    limit_linear_algebra_threads()
    from planner.service.backgrounds.map_background import MapBackground
    from planner.service.errors import ServiceError
    from planner.service.store.carried_bytes import check_result_place
    from planner.service.store.database import hold_service_lock

    settings = build_settings(
        data, database, results=results, host=host, port=port, public_url=public_url.rstrip("/"),
        video_hosts=tuple(video_host or ()), background=background,
        background_attribution=background_attribution, background_zoom=background_zoom,
        background_cache_mb=background_cache_mb, **_share_cores(workers, least=0),
    )  # fmt: skip
    if settings.workers == 0 and not settings.is_shared:
        raise ServiceError(
            "Without workers of its own the service needs PostgreSQL, from which headland worker takes jobs; give its "
            "--database, or more --workers.",
            parameter="workers",
        )
    check_result_place(settings)
    MapBackground(settings)  # the office opens it later; a wrong one is refused here
    try:
        with hold_service_lock(settings):
            _run_server(settings)
    except KeyboardInterrupt:
        stop_repeating()


def worker(
    database: Annotated[str, typer.Option("--database", help="URL of the PostgreSQL of the service.")],
    results: ResultsOption = "",
    workers: Annotated[Optional[int], typer.Option(help=WORKERS_HELP)] = None,
) -> None:
    """Compute jobs of a service on this machine, by way of its PostgreSQL; Ctrl-C gives back what is under way.

    It needs neither the folder of the service nor a port. Exit status 4: the service is of another version; 1: the
    store of results does not answer.

    Example: headland worker --database postgresql://headland@farm.example/headland --workers 4
    """
    limit_linear_algebra_threads()
    from planner.service.gateway.request_logs import set_up_logs
    from planner.service.jobs.workers import run_remote_workers
    from planner.service.store.carried_bytes import check_result_place

    with tempfile.TemporaryDirectory(prefix="headland-worker-") as folder:
        settings = build_settings(Path(folder), database, results=results, **_share_cores(workers, least=1))
        check_result_place(settings)
        set_up_logs()
        run_remote_workers(settings, lambda: typer.echo(f"Jobs at a time: {settings.workers}; Ctrl-C ends it."))


def _share_cores(workers: int | None, least: int) -> dict[str, int]:
    """Settings for this many jobs at a time, which share the cores; raises ServiceError for impossible ones."""
    from planner.service.errors import ServiceError
    from planner.service.settings import count_cores

    if workers is None:
        return {}
    if not least <= workers <= MOST_WORKERS:
        raise ServiceError(f"--workers is {workers}; use {least} to {MOST_WORKERS}.", parameter="workers")
    return {"workers": workers, "processes": max(1, count_cores() // max(1, workers))}


def build_settings(data: Path | None, database: str, **overrides: object) -> ServiceSettings:
    """Settings from the options; raises ServiceError for impossible ones."""
    from planner.service.settings import ServiceSettings, find_default_data

    # Data of the service (digests of tokens, logs, backups) can be read only by its user.
    os.umask(0o077)
    folder = find_default_data() if data is None else data
    from planner.service.errors import ServiceError

    if folder.exists() and not folder.is_dir():
        raise ServiceError(f"{folder} is a file; give the name of a folder.", parameter="data")
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        raise ServiceError(f"The folder {folder} cannot be made: {error.strerror}; give another --data.") from None
    if not os.access(folder, os.W_OK):
        raise ServiceError(f"The folder {folder} cannot be written to: no permission; give another --data.")
    return ServiceSettings(data=folder, database=database, **overrides)  # type: ignore[arg-type]


def _run_server(settings: ServiceSettings) -> None:
    """Serve until the process is ended."""
    import asyncio

    import uvicorn

    from planner.pipeline.kernels import MORE, PLAN
    from planner.service.access.permissions import is_operator
    from planner.service.api.apps import create_control_app, run_back_office
    from planner.service.gateway.back_office import BackOffice
    from planner.service.gateway.connection_limits import ConnectionRegistry, compute_connection_limits
    from planner.service.gateway.connection_protocol import LimitedWebSocket, build_limited_protocol_class
    from planner.service.gateway.request_logs import set_up_logs
    from planner.service.settings import LIMITS

    set_up_logs()
    _require_tokens(settings)
    connections = ConnectionRegistry(compute_connection_limits())
    office = BackOffice(settings, run_back_office)
    app = create_control_app(settings, office, connections)
    if settings.is_own_machine:
        app.state.logins.make_token = app.state.store.create_browser_token
    config = uvicorn.Config(
        app, log_config=None, access_log=False, proxy_headers=False, server_header=False,
        http=build_limited_protocol_class(connections, partial(is_operator, app.state.book)), ws=LimitedWebSocket,
        ws_max_size=LIMITS.most_frame_bytes, ws_per_message_deflate=False, timeout_graceful_shutdown=LIMITS.shutdown_s,
        backlog=LIMITS.accepts_per_turn,
    )  # fmt: skip

    class AnnouncingServer(uvicorn.Server):
        """Announces its address once the office can show pages there; it can be ended before."""

        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            # Loaded modules stay: collecting garbage among them would block the event loop for long.
            gc.collect()
            gc.freeze()
            if sockets and not self.should_exit:
                sockets[0].listen(
                    LIMITS.backlog
                )  # those that may wait; uvicorn's backlog is how many it accepts at a time
                self.announcement = asyncio.create_task(self.announce(sockets[0].getsockname()[1]))

        async def announce(self, port: int) -> None:
            await office.wait_until_ready()
            _print_service_address(settings, app.state.logins, port)

    with _open_socket(settings) as server_socket:
        compile_apart((PLAN, MORE))  # the process that stops tractors stays small
        AnnouncingServer(config).run(sockets=[server_socket])


def _print_service_address(settings: ServiceSettings, logins: BrowserLogins, port: int) -> None:
    """Print the address of the service and the login link for a browser of this user."""
    host = f"[{settings.host}]" if ":" in settings.host else settings.host
    base = settings.public_url or f"http://{host}:{port}"

    def show_login(code: str, label: str = "Open this address to log in another browser, once") -> None:
        typer.echo(f"{label}: {base}/login?code={code}")
        sys.stdout.flush()

    logins.on_used = show_login
    typer.echo(f"Headland listens on http://{host}:{port}/ and stores its data in {settings.data}; Ctrl-C ends it.")
    show_login(logins.code, "Open this address in your browser, once")
    typer.echo(f"A token for somebody else: headland token new{settings.data_option} --scope planner --name NAME")
    sys.stdout.flush()


def _require_tokens(settings: ServiceSettings) -> None:
    """Refuse to listen for other machines while there is no token."""
    from planner.service.errors import ServiceError
    from planner.service.store.service_store import open_store

    if settings.local:
        return
    with open_store(settings) as store:
        any_token = bool(store.list_tokens())
    if not any_token:
        raise ServiceError(
            f"The host {settings.host} is open to other machines, which need a token, and there is none; make one with "
            f"headland token new{settings.data_option} --scope operator, or leave out --host.",
            parameter="host",
        )


def _open_socket(settings: ServiceSettings) -> socket.socket:
    """A listening socket; raises ServiceError if the address cannot be used."""
    import socket

    from planner.service.errors import ServiceError
    from planner.service.settings import LIMITS

    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    server_socket = socket.socket(family, socket.SOCK_STREAM)
    if os.name == "posix":
        server_socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        server_socket.bind((settings.host.strip("[]"), settings.port))
    except OSError as error:
        server_socket.close()
        reason = error.strerror or str(error)
        raise ServiceError(
            f"The service cannot listen on {settings.host} port {settings.port}: {reason}; give another "
            "--port or --host."
        ) from None
    server_socket.listen(LIMITS.backlog)
    return server_socket


def backup(
    file: Annotated[Path, typer.Argument(help="The file to write, such as farm.zip.")],
    data: DataOption = None,
    database: DatabaseOption = "",
    force: ForceOption = False,
) -> None:
    """Write all data of the service into one file, also while it runs; unpacked it is a folder for --data.

    Example: headland backup farm.zip
    """
    from planner.service.store.backup import back_up

    check_output_paths((file, ".zip"), force=force)
    replaced = [file] if file.exists() else []
    with _open_store(data, database) as store:
        count = back_up(store, file)
    print_written([file], replaced)
    typer.echo(f"{file} has the database and {count} files; unpack it into an empty folder to use that with --data.")


def restore(
    file: Annotated[Path, typer.Argument(help="A file of headland backup.")],
    data: DataOption = None,
    database: DatabaseOption = "",
) -> None:
    """Restore a backup into an empty folder and database, SQLite or PostgreSQL, that no service uses.

    The backup is checked first: a damaged or incomplete one is refused and changes nothing.

    Example: headland restore farm.zip --data farm
    """
    from planner.service.store.backup import restore_backup
    from planner.service.store.database import hold_service_lock
    from planner.service.store.service_store import open_store

    settings = build_settings(data, database)
    with hold_service_lock(settings), open_store(settings) as store:
        count = restore_backup(store, file)
    typer.echo(
        f"The database and {count} files of {file} are restored to {settings.data}; begin with "
        f"headland serve{settings.data_option}."
    )


token = create_group(
    "Tokens for the service: who may read, plan, operate, drive or administer.\n\n"
    "Example: headland token new --scope operator --name office"
)


@token.command()
def new(
    scope: Annotated[list[str], typer.Option(help=SCOPE_HELP)],
    name: Annotated[Optional[str], typer.Option(help="Name of the token; by default its scope and a number.")] = None,
    fleet: Annotated[Optional[str], typer.Option(help="Id of the fleet of a robot.")] = None,
    tractor: Annotated[Optional[int], typer.Option(help="Tractor that a robot drives, from 1.")] = None,
    expires: Annotated[Optional[str], typer.Option(help=EXPIRES_HELP)] = None,
    data: DataOption = None,
    database: DatabaseOption = "",
) -> None:
    """Make a token and print it; it is shown only once and not stored.

    Example: headland token new --scope operator --expires 30d
    """
    from planner.service.store.token_table import check_scopes

    scopes = check_scopes(" ".join(scope).split())
    with _open_store(data, database) as store:
        taken, number = {row.name for row in store.list_tokens()}, 1
        while f"{'-'.join(scopes)}-{number}" in taken:
            number += 1
        token_name = name or f"{'-'.join(scopes)}-{number}"
        text, row = store.create_token(token_name, scopes, fleet=fleet, tractor=tractor, expires=expires)
    typer.echo(text)
    typer.echo(
        f"Store it safely: it is shown only once and gives its scope to whoever has it. It {_describe_expiry(row)}.",
        err=True,
    )


@token.command(name="list")
def list_tokens(data: DataOption = None, database: DatabaseOption = "") -> None:
    """List tokens by name, with scopes, creation and expiry.

    Example: headland token list
    """
    with _open_store(data, database) as store:
        rows = store.list_tokens()
    for row in rows:
        bound = f" of tractor {row.tractor} of fleet {row.fleet}" if row.fleet else ""
        typer.echo(f"{row.name}  {row.scopes}{bound}  {row.created}  {_describe_expiry(row)}")


def _describe_expiry(row: TokenRow) -> str:
    """When a token expires: ``never expires``, ``expires 2027-01-31``."""
    from planner.service.store.token_table import has_expired

    if row.expires is None:
        return "never expires"
    return f"{'expired' if has_expired(row) else 'expires'} {row.expires}"


@token.command()
def revoke(
    name: Annotated[str, typer.Argument(help="The name of the token.")],
    data: DataOption = None,
    database: DatabaseOption = "",
) -> None:
    """Revoke a token: it is refused from now on.

    Example: headland token revoke office
    """
    with _open_store(data, database) as store:
        store.revoke_token(name)
    typer.echo(f"The token {name} is revoked.")


def _open_store(data: Path | None, database: str) -> AbstractContextManager[Store]:
    from planner.service.store.service_store import open_store

    return open_store(build_settings(data, database))
