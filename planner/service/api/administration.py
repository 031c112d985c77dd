"""Routes for health, readiness, caller, login, tokens, events, and metrics for Prometheus.

Metrics are of requests, links, ages, stops, jobs, database, disk, and memory and descriptors of both processes.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from typing import Annotated

from fastapi import Query, Request, Response
from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector, generate_latest
from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from pydantic import Field
from sqlalchemy.exc import SQLAlchemyError
from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse

from planner.errors import HeadlandError
from planner.fleet.session.inbound_frames import TractorNumber
from planner.service.access.browsers import BrowserLogins
from planner.service.access.permissions import (
    READ,
    RIGHTS_BY_SCOPE,
    AdminAccess,
    OwnReadAccess,
    ReadAccess,
    identify_caller,
    read_bearer,
)
from planner.service.errors import StorageError
from planner.service.fleets.fleet_sessions import FleetSessions
from planner.service.gateway.connection_limits import ConnectionRegistry
from planner.service.gateway.request_gate import BodyBudget
from planner.service.gateway.responses import (
    HTTP_METHODS,
    ApiRequest,
    ApiRouter,
    CallerInfo,
    EventList,
    HealthInfo,
    NewToken,
    ReadinessInfo,
    StoreAccess,
    TokenInfo,
    TokenList,
    build_error_response,
)
from planner.service.settings import LIMITS, find_version
from planner.service.store.database_watch import DatabaseWatch, TokenCache
from planner.service.store.job_queue import JOB_STATUSES
from planner.service.store.service_store import Store
from planner.service.store.token_table import TokenScope

METRICS_MEDIA_TYPE = "text/plain; version=0.0.4; charset=utf-8"
LATENCY_BUCKETS_S = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0, 60.0)
DATABASE_DOWN = "The database has not answered for {age_s:.0f} s. Stops and links work; nothing is recorded."
NOTHING_WRITTEN = "The database has taken no writes for {age_s:.0f} s. Stops and links work; nothing is recorded."
OFFICE_STARTING = "The process for files, jobs and pages is starting. Stops and links work."


class MeasuredMetrics(Collector):
    """Metrics that a function measures whenever they are read."""

    def __init__(self, measure: Callable[[], Iterable[Metric]]) -> None:
        self.measure = measure

    def collect(self) -> Iterable[Metric]:
        """The metrics, for prometheus_client."""
        return self.measure()


class ServiceMetrics:
    """Metrics that are counted as things happen, and gauges that are set when they are read."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)  # memory, descriptors and CPU of this process, where Linux shows them
        self.requests = Histogram(
            "headland_request_seconds",
            "How long requests took, forwarded ones included.",
            ("method", "status"),
            registry=self.registry,
            buckets=LATENCY_BUCKETS_S,
        )
        self.stops = Counter("headland_stops", "Orders to stop a whole fleet.", ("by",), registry=self.registry)
        self.stop_seconds = Histogram(
            "headland_stop_seconds",
            "From an order to stop until it is sent to the last link.",
            registry=self.registry,
            buckets=(0.001, 0.005, 0.01, 0.05, 0.1, 0.5, 1.0),
        )
        gauge = partial(Gauge, registry=self.registry)
        self.office_starts = gauge("headland_office_starts", "How often the office was started.")
        self.ready = gauge("headland_ready", "1 when database and office can be used.")
        self.loop_lag_s = gauge("headland_loop_lag_seconds", "By how much the last step of the fleets came late.")
        self.jobs, self._jobs_counted_s = gauge("headland_jobs", "Jobs by state.", ("status",)), float("-inf")

    def add_measured(self, measure: Callable[..., Iterable[Metric]], *sources: object) -> None:
        """Add metrics that a function measures of its sources whenever they are read."""
        self.registry.register(MeasuredMetrics(partial(measure, *sources)))

    def observe_request(self, method: str, status: int, seconds: float) -> None:
        """Count an answered request."""
        method = method if method in HTTP_METHODS else "other"
        self.requests.labels(method, f"{status // 100}xx").observe(seconds)

    def count_stop(self, source: str, seconds: float) -> None:
        """Count an order to stop a fleet, over HTTP or a link, that was sent to all of its links."""
        self.stops.labels(source).inc()
        self.stop_seconds.observe(seconds)

    def update_job_counts(self, store: Store) -> None:
        """Count the jobs in the database where the last count is old; call this in a thread. Raises DBAPIError."""
        if time.monotonic() - self._jobs_counted_s < LIMITS.job_count_period_s:
            return
        self._jobs_counted_s = time.monotonic()
        counts = store.count_jobs()
        for state in JOB_STATUSES:
            self.jobs.labels(state).set(counts.get(state, 0))


def measure_fleets(hub: FleetSessions) -> Iterable[Metric]:
    """Links, time since the last report of each tractor, and alarms, by fleet."""
    links = GaugeMetricFamily("headland_links", "Links that are open.", labels=("fleet", "role"))
    ages = GaugeMetricFamily(
        "headland_report_age_seconds", "Seconds since the last report of a linked tractor.", labels=("fleet", "tractor")
    )
    alarms = GaugeMetricFamily("headland_alarms", "Alarms that are on.", labels=("fleet", "level"))
    now = time.monotonic()
    for id, fleet in list(hub.by_id.items()):
        roles = [client.role for client in fleet.clients]
        for role in sorted(set(roles)):
            links.add_metric((id, role), roles.count(role))
        for number in sorted(fleet.tractors):
            heard_s = now - fleet.manager.states[number].last_contact_s
            ages.add_metric((id, str(number + 1)), max(heard_s, 0.0))
        levels = [alarm.level for alarm in fleet.manager.alarms.list_alarms() if not alarm.over]
        for level in sorted(set(levels)):
            alarms.add_metric((id, level), levels.count(level))
    return links, ages, alarms


def measure_store(store: Store, watch: DatabaseWatch, bodies: BodyBudget) -> Iterable[Metric]:
    """Database, room on the disk, and bodies under way."""
    values = {
        "headland_database_write_age_seconds": ("Since a write went through.", watch.age_s),
        "headland_database_write_seconds": ("How long the last write took.", watch.last_write_s),
        "headland_bodies_bytes": ("Large bodies under way.", bodies.held_bytes),
        "headland_bodies_limit_bytes": ("Room for large bodies.", bodies.most_bytes),
    }
    with suppress(OSError):
        free_bytes = shutil.disk_usage(store.settings.data).free
        values["headland_disk_free_bytes"] = ("Room on the disk of the data folder.", free_bytes)
    return [GaugeMetricFamily(name, text, value=value) for name, (text, value) in values.items()]


def measure_connections(connections: ConnectionRegistry) -> Iterable[Metric]:
    """Open connections, and those that were closed unfinished."""
    opened = GaugeMetricFamily("headland_connections", "Open connections other than links.", value=len(connections))
    closed = GaugeMetricFamily("headland_connections_closed", "Unfinished connections closed, by why.", labels=("why",))
    for why, count in sorted(connections.closed_by_reason.items()):
        closed.add_metric((why,), count)
    return opened, closed


health_router = ApiRouter(tags=["service"])


@health_router.get("/health")
async def show_health(request: Request) -> HealthInfo:
    """Whether the service runs, its version, and what is missing now; this does not query the database."""
    faults = list_service_faults(request)
    return HealthInfo(status="degraded" if faults else "ok", version=find_version(), faults=faults)


@health_router.get("/ready", responses={503: {"model": ReadinessInfo, "description": "Something is missing"}})
async def show_readiness(request: Request, response: Response) -> ReadinessInfo:
    """Whether everything works: 200, or 503 with what is missing."""
    faults = list_service_faults(request)
    response.status_code = 503 if faults else 200
    return ReadinessInfo(ready=not faults, faults=faults)


@health_router.get("/me")
async def show_caller(caller: OwnReadAccess) -> CallerInfo:
    """The caller: name of the token, and its rights."""
    rights = sorted({right for scope in caller.scopes for right in RIGHTS_BY_SCOPE[scope]})
    command = caller.format_token_command("planner --scope operator")
    return CallerInfo(
        name=caller.name, rights=rights, fleet=caller.fleet, tractor=caller.tractor, token_command=command,
        identity=caller.identity,
    )  # fmt: skip


async def log_in_browser(request: Request) -> Response:
    """Log in the browser that opens the address which `headland serve` printed.

    A HEAD request, such as a link preview, does not use the address up.
    """
    if request.method != "GET":
        return build_error_response(405, "This address takes GET.", {"allow": "GET"})
    logins: BrowserLogins = request.app.state.logins
    code = request.query_params.get("code", "")
    if logins.is_logged_in(request) and not (logins.make_token and logins.is_current_code(code)):
        return RedirectResponse("/", 303)  # opened again from the history or a bookmark
    response = logins.log_in_browser(code)
    token_text = await run_in_threadpool(logins.make_token) if logins.make_token else None
    if token_text is not None:
        response.headers["location"] = f"/#token={token_text}"  # what follows the # is sent to nobody
    return response


async def show_metrics(request: Request) -> Response:
    """Metrics for Prometheus; they need the right to read."""
    state = request.app.state
    (await identify_caller(request, read_bearer(request))).check_right(READ)
    metrics: ServiceMetrics = state.metrics
    faults = list_service_faults(request)
    if state.book.is_fresh:
        with suppress(SQLAlchemyError, HeadlandError):
            await run_in_threadpool(metrics.update_job_counts, state.store)
    metrics.loop_lag_s.set(state.hub.lag_s)
    metrics.ready.set(0 if faults else 1)
    metrics.office_starts.set(0 if state.office is None else state.office.kept_process.starts)
    return Response(generate_latest(metrics.registry), media_type=METRICS_MEDIA_TYPE)


def list_service_faults(request: Request) -> list[str]:
    """What is missing in the service now, one sentence each."""
    state = request.app.state
    book: TokenCache = state.book
    faults = []
    if not book.is_fresh:
        faults.append(DATABASE_DOWN.format(age_s=min(book.age_s, 1e6)))
    elif not state.watch.is_fresh:
        faults.append(NOTHING_WRITTEN.format(age_s=min(state.watch.age_s, 1e6)))
    try:
        state.store.blobs.check_disk_space(0)
    except StorageError as error:
        faults.append(str(error))
    if state.office is not None and state.office.url is None:
        faults.append(OFFICE_STARTING)
    return faults


events_router = ApiRouter(tags=["events"])


@events_router.get("/events")
def list_events(
    store: StoreAccess,
    _caller: ReadAccess,
    since: Annotated[int, Query(ge=0, le=LIMITS.largest_event_id, description="Only events of a higher number.")] = 0,
    fleet: Annotated[str | None, Query(max_length=32, description="Only events of this fleet.")] = None,
) -> EventList:
    """Events after a number, the oldest first, at most 1000; for more, ask again from the last number."""
    return EventList.model_validate({"items": store.list_events(since, fleet)})


tokens_router = ApiRouter(prefix="/tokens", tags=["tokens"])


class TokenRequest(ApiRequest):
    """A new token; one of the scope robot is bound to a `tractor`, counted from 1, of a `fleet`, by its id.

    `expires` is a period (90m, 12h, 30d), a date, a time or never; by default a robot's token expires after 30 days and
    others never.
    """

    name: Annotated[str, Field(max_length=100, description="Name of the token.")]
    scopes: Annotated[list[TokenScope], Field(min_length=1, max_length=5)]
    fleet: Annotated[str, Field(max_length=32)] | None = None
    tractor: TractorNumber | None = None
    expires: Annotated[str, Field(max_length=40)] | None = None


@tokens_router.get("", operation_id="list_tokens")
def list_tokens(store: StoreAccess, _caller: AdminAccess) -> TokenList:
    """All tokens with name, scopes and expiry; their texts are stored nowhere."""
    return TokenList.model_validate({"items": store.list_tokens()})


@tokens_router.post("", status_code=201, operation_id="make_token")
def create_token(store: StoreAccess, caller: AdminAccess, body: TokenRequest) -> NewToken:
    """Make a token; its text is shown only once."""
    text, row = store.create_token(body.name, body.scopes, fleet=body.fleet, tractor=body.tractor, expires=body.expires)
    info = TokenInfo.model_validate(row)
    store.add_event(None, caller.name, "token made", info.model_dump(exclude_none=True, exclude={"created"}))
    return NewToken(**info.model_dump(), token=text)


revocation_router = ApiRouter(prefix="/tokens", tags=["tokens"])


@revocation_router.delete("/{name}", status_code=204, operation_id="revoke_token")
async def revoke_token(request: Request, caller: AdminAccess, name: str) -> None:
    """Revoke a token: it is refused and its links end at once, also while the database cannot be written to."""
    try:
        await request.app.state.book.revoke_token(name, caller.name)
    finally:
        await request.app.state.hub.check_tokens()
