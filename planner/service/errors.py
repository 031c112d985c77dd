"""Refusals of the service: each is one sentence, with its HTTP status."""

from __future__ import annotations

from planner.errors import HeadlandError
from reports.common.language import mark_text


class ServiceError(HeadlandError):
    """A request that cannot be fulfilled."""

    http_status = 422


class TokenError(ServiceError):
    """No token where one is needed, or an unknown one."""

    http_status = 401


class ScopeError(ServiceError):
    """A token without the right, or a request from a page of another site."""

    http_status = 403


class NotFoundError(ServiceError):
    """Nothing of that name."""

    http_status = 404


class ConflictError(ServiceError):
    """A name that is taken, or a state that does not allow the request."""

    http_status = 409


class TooLargeError(ServiceError):
    """Too many bytes."""

    http_status = 413


class BusyError(ServiceError):
    """Too many requests or jobs."""

    http_status = 429


class DatabaseError(ServiceError):
    """A database that cannot be used."""

    http_status = 503


class VersionError(ServiceError):
    """A worker of another version than the service."""

    http_status = 409
    status = 4


class StorageError(ServiceError):
    """No room left on the disk; commands exit with status 1, as the request itself was fine."""

    http_status = 507
    status = 1
    waiting = mark_text("waits for room on the disk")
    """What a job does meanwhile."""


class ResultPlaceError(StorageError):
    """A store of results that does not answer or cannot be written to."""

    http_status = 503
    waiting = mark_text("waits for the store of results")
