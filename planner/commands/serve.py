"""`headland serve`: the service and its pages."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

if TYPE_CHECKING:
    import socket

    from planner.service.settings import Settings

Data = Annotated[
    Optional[Path],  # noqa: UP045 - typer reads this at run time
    typer.Option("--data", help="Folder that holds all the service has; by default one of the user's data."),
]
DatabaseOption = Annotated[
    str, typer.Option("--database", help="URL of PostgreSQL or SQLite; by default a file of SQLite in the folder.")
]
PATIENCE_S = 5
MOST_FRAME_BYTES = 2**20
BACKLOG = 1024


def serve(
    host: Annotated[str, typer.Option(help="Address to listen on; another than this machine's asks for tokens.")] = (
        "127.0.0.1"
    ),
    port: Annotated[int, typer.Option(help="Port to listen on.")] = 8765,
    data: Data = None,
    database: DatabaseOption = "",
) -> None:
    """Plan, watch and drive fleets from a page: http://127.0.0.1:8765.

    Example: headland serve --data farm
    """
    from planner.commands.single import one_thread
    from planner.interrupts import quiet
    from planner.service.store.holding import held

    one_thread()
    settings = settings_of(data, database, host=host, port=port)
    try:
        with held(settings):
            _run(settings)
    except KeyboardInterrupt:
        quiet()


def settings_of(data: Path | None, database: str, **more: object) -> Settings:
    """Settings by the options; raises ServiceError for those that cannot be."""
    from planner.service.settings import Settings, default_data

    # What the service has (tokens' digests, logs, backups) is its user's alone, whoever may look into the folder.
    os.umask(0o077)
    folder = default_data() if data is None else data
    _check_folder(folder)
    return Settings(data=folder, database=database, **more)  # type: ignore[arg-type]


def _check_folder(folder: Path) -> None:
    """Refuse a folder that cannot be one for the service."""
    from planner.service.errors import ServiceError

    if folder.exists() and not folder.is_dir():
        raise ServiceError(f"{folder} is a file; give the name of a folder.", parameter="data")
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        raise ServiceError(f"The folder {folder} cannot be made: {error.strerror}; give another --data.") from None
    if not os.access(folder, os.W_OK):
        raise ServiceError(f"The folder {folder} cannot be written to: no permission; give another --data.")


def _run(settings: Settings) -> None:
    """Listen until somebody ends it."""
    import uvicorn

    from planner.commands.show import warm_up
    from planner.service.api import create_app

    _demand_tokens(settings)
    app = create_app(settings)
    config = uvicorn.Config(
        app, log_level="warning", access_log=False, proxy_headers=False, server_header=False, ws="websockets-sansio",
        ws_max_size=MOST_FRAME_BYTES, timeout_graceful_shutdown=PATIENCE_S,
    )  # fmt: skip
    class Telling(uvicorn.Server):
        """Says where it listens once it does."""

        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            if sockets and not self.should_exit:
                typer.echo(_told(settings, sockets[0].getsockname()[1]))
                sys.stdout.flush()

    with _listening(settings) as listening:
        warm_up()
        Telling(config).run(sockets=[listening])


def _told(settings: Settings, port: int) -> str:
    """Where the service is, in a sentence."""
    shown = f"[{settings.host}]" if ":" in settings.host else settings.host
    return f"Headland listens on http://{shown}:{port}/ and keeps all in {settings.data}; Ctrl-C ends it."


def _demand_tokens(settings: Settings) -> None:
    """Refuse to let others in where nobody could have a token."""
    from planner.service.errors import ServiceError
    from planner.service.store import opened

    if settings.local:
        return
    with opened(settings) as store:
        any_token = bool(store.tokens())
    if not any_token:
        raise ServiceError(
            f"The host {settings.host} lets other machines in, and there is no token for them; make one with headland "
            "token new --scope control, or leave out --host.",
            parameter="host",
        )


def _listening(settings: Settings) -> socket.socket:
    """A socket that listens; raises ServiceError where that cannot be."""
    import socket

    from planner.service.errors import ServiceError

    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    if os.name == "posix":
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((settings.host.strip("[]"), settings.port))
    except OSError as error:
        listening.close()
        why = error.strerror or str(error)
        raise ServiceError(
            f"Nothing can listen on {settings.host} port {settings.port}: {why}; give another --port or --host."
        ) from None
    listening.listen(BACKLOG)
    return listening
