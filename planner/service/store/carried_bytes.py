"""A store by which results come from workers on other machines: an fsspec URL whose credentials come from the worker's
own environment."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any
from uuid import uuid4

from planner.service.errors import NotFoundError, ResultPlaceError, ServiceError
from planner.service.settings import CONNECT_TIMEOUT_S, ServiceSettings
from planner.service.store.database import shorten_error

READ_TIMEOUT_S = 60.0  # of a store that is asked: the service has other work too
_OPTIONS = {"s3": {"config_kwargs": {"connect_timeout": CONNECT_TIMEOUT_S, "read_timeout": READ_TIMEOUT_S}}}


class ResultPlace:
    """A folder of a store, opened when it is used."""

    def __init__(self, address: str) -> None:
        self.address = address.rstrip("/")

    @cached_property
    def _files(self) -> Any:
        """The file system of fsspec. Raises ServiceError for an address that cannot be used."""
        scheme, mark, path = self.address.partition("://")
        try:
            import fsspec

            if not mark or not path.strip("/"):
                raise ValueError("it is no URL with a folder")
            return fsspec.filesystem(scheme, use_listings_cache=False, **_OPTIONS.get(scheme, {}))
        except Exception as error:  # libraries of stores raise anything
            raise ServiceError(
                f"Results cannot go to {self.address!r}: {_shorten(error)}; give an address such as "
                "s3://bucket/folder (--results) and install headland[s3], or what fsspec needs for another store.",
                parameter="results",
            ) from None

    def locate(self, name: str) -> str:
        """The address of what has a name here."""
        return f"{self.address}/{name}"

    def holds(self, address: str) -> bool:
        """Whether an address is of this place."""
        return address.rpartition("/")[0] == self.address

    def check(self) -> None:
        """Write something, read it and delete it. Raises ServiceError, ResultPlaceError where that does not work."""
        name = f"headland-check-{uuid4().hex}"  # processes that start together check apart
        self.put_bytes(name, b"Headland")
        with self._translate_errors():
            self._files.cat_file(self.locate(name))
        self.delete(self.locate(name))

    def put_bytes(self, name: str, content: bytes) -> None:
        """Store bytes by name. Raises ResultPlaceError."""
        files = self._files
        with self._translate_errors():
            files.auto_mkdir = True  # in a folder of this machine
            files.pipe_file(self.locate(name), content)

    def read_bytes(self, address: str) -> bytes:
        """The bytes at an address. Raises NotFoundError, ResultPlaceError."""
        files = self._files
        with self._translate_errors():
            try:
                return bytes(files.cat_file(address))
            except FileNotFoundError:
                raise NotFoundError(f"The result {address} is gone from its store; compute it again.") from None

    def delete(self, address: str) -> None:
        """Delete what is at an address. Raises ResultPlaceError."""
        files = self._files
        with self._translate_errors():
            files.rm_file(address)

    @contextmanager
    def _translate_errors(self) -> Iterator[None]:
        """Turn what a library of a store raises, which may be anything, into ResultPlaceError."""
        try:
            yield
        except NotFoundError:
            raise
        except Exception as error:
            raise ResultPlaceError(
                f"The store of results {self.address} does not answer as it should ({_shorten(error)}); see that it "
                "runs, that the bucket exists, and that the environment has credentials."
            ) from error


def check_result_place(settings: ServiceSettings) -> None:
    """Refuse results by a store that cannot be used, or where no PostgreSQL names them; raises ServiceError."""
    if settings.results and not settings.is_shared:
        raise ServiceError(
            "Results go by a store from workers on other machines, which need PostgreSQL; give its --database, or no "
            "--results.",
            parameter="results",
        )
    if settings.results:
        ResultPlace(settings.results).check()


def _shorten(error: Exception) -> str:
    return shorten_error(f"{type(error).__name__}: {error}").rstrip(".")
