"""Refusals of the service: each is one sentence, with the status that HTTP has for it.

    ServiceError                 a request that cannot be done as it stands (422)
    ├── TokenError               no token, or one that is not known (401)
    ├── ScopeError               a token that may not do this (403)
    ├── MissingError             nothing of that name (404)
    ├── TakenError               a name or a state that stands in the way (409)
    ├── SizeError                more bytes than are taken (413)
    ├── BusyError                more requests or jobs than are taken (429)
    └── DatabaseError            a database that cannot be used (503)
"""

from __future__ import annotations

from planner.errors import HeadlandError


class ServiceError(HeadlandError):
    """A request that cannot be done as it stands."""

    http = 422


class TokenError(ServiceError):
    """No token where one is needed, or one that is not known."""

    http = 401


class ScopeError(ServiceError):
    """A token that may not do what is asked, or a page of another site that asks."""

    http = 403


class MissingError(ServiceError):
    """Nothing of that name."""

    http = 404


class TakenError(ServiceError):
    """A name that is taken, or a state in which this cannot be done."""

    http = 409


class SizeError(ServiceError):
    """More bytes than are taken."""

    http = 413


class BusyError(ServiceError):
    """More requests, or more jobs, than are taken."""

    http = 429


class DatabaseError(ServiceError):
    """A database that cannot be used."""

    http = 503
