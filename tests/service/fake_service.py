"""A service that speaks the interface with made-up data, for the pages alone: REST, link, files, jobs."""

import asyncio
import math
from contextlib import suppress
from typing import Any

from fastapi import FastAPI, Request, WebSocket, WebSocketDisconnect
from fastapi.responses import HTMLResponse, JSONResponse, Response

from planner.farm.settings import read_example_text
from planner.fleet.model.tractor_state import POSITIONS, PROGRESS, SPEED, MotionDoubt
from planner.fleet.safety.compliance import describe_doubt
from planner.service.access.browsers import REPORT_SECURITY_POLICY, SecurityHeadersMiddleware
from planner.service.api.job_routes import build_plan_form
from planner.service.errors import ServiceError
from planner.service.fleets.video_addresses import check_video_address, find_origin
from planner.service.pages.static_files import mount_pages
from planner.service.sandbox.readings import FORMS
from tests.service import made_field

BEGUN_S, BEAT_S = 200.0, 0.1
CONTROL = "hl_control"
NASTY = '<img src=x onerror="document.title=1">'
REPORT = (
    '<!doctype html><title>r</title><style>p{color:green}</style><p id="p">no</p>'
    '<script>document.getElementById("p").textContent="the report runs"</script>'
)


EVENT = {"id": 1, "time": "2026-11-20T08:30:00Z", "fleet": "f1", "who": "office", "what": "start", "data": {}}
SAID = {"kind": "event", "time": "2026-11-20T09:11:00Z", "who": "office"}
NOTHING = {"named": [], "words": "Nothing was found that the tractor file lacks.", "extends_model": False}
UNDERSTEER = {"named": ["understeer"], "words": "The tractor turns less than its wheels say.", "extends_model": True}


class Made:
    """What the service was told, for tests to look at."""

    def __init__(self) -> None:
        self.frames: list[dict[str, Any]] = []
        self.requests: list[tuple[str, Any]] = []
        self.estimates: list[dict[str, Any]] = []
        self.files = {"fields": ["iwamizawa", "north field", NASTY], "tractors": ["eg105"], "farms": ["farm"]}
        self.files |= {"tables": ["rain"], "elevations": ["hill"], "logs": ["run-1"]}
        self.options: dict[str, dict[str, Any]] = {}
        self.state = "running"  # of the fleet
        self.polls = self.knocks = self.left = 0
        self.diagnosed = self.deaf = self.looked = self.shut = False
        self.finding = NOTHING
        self.holder: str | None = None
        self.acknowledged: str | None = None
        self.videos: dict[int, str] = {}
        self.area_m: float | None = None  # of the circle that tractor 2 may be in
        self.silent = self.cut = False  # a link that says nothing, and one that is closed


def fake_app() -> FastAPI:
    """The app; `app.state.made` is what it was told."""
    app = FastAPI()
    made = app.state.made = Made()
    lanes = [made_field.lane_of(number) for number in range(1, made_field.COUNT + 1)]
    app.add_middleware(
        SecurityHeadersMiddleware,
        list_video_origins=lambda: [one for one in map(find_origin, made.videos.values()) if one],
    )

    @app.get("/api/v1/health")
    def health() -> dict[str, Any]:
        return {"status": "ok", "version": "0.2.0", "faults": []}

    @app.get("/api/v1/me")
    def me() -> dict[str, Any]:
        bound = {"fleet": None, "tractor": None, "token_command": "headland token new"}
        return {"name": "office", "rights": ["operate", "plan", "read"]} | bound

    @app.get("/api/v1/background")
    def background() -> dict[str, Any]:
        return {"kind": "none", "attribution": "", "least_zoom": 0, "most_zoom": 0, "tile_px": 256, "bounds_deg": None}

    _fleets(app, made)
    _forms(app)
    _estimates(app, made)
    _files(app, made)
    _jobs(app, made)

    @app.websocket("/api/v1/fleets/{fleet}/link")
    async def link(socket: WebSocket, fleet: str) -> None:
        made.knocks += 1
        while made.shut or made.cut:
            await asyncio.sleep(0.01)
        try:
            await socket.accept()
            with suppress(WebSocketDisconnect, RuntimeError):
                await _served(socket, made, lanes)
        finally:
            made.left += 1

    mount_pages(app)
    return app


def _files(app: FastAPI, made: Made) -> None:
    @app.get("/api/v1/{kind}", include_in_schema=False)
    def listed(kind: str) -> Any:
        if kind in made.files:
            samples, options = ("iwamizawa", "eg105"), made.options
            items = [{"name": name, "sample": name in samples, "size": 41_000} for name in made.files[kind]]
            return {"items": [item | {"options": options.get(str(item["name"]), {})} for item in items]}
        if kind == "events":
            return {"items": [EVENT]}
        if kind == "fleets":
            return {"items": [_fleet()]}
        if kind in ("plans", "days", "diagnoses"):
            return {"items": [_job(kind, "old", "done", made)]}
        return JSONResponse({"error": f"There is no list {kind}.", "parameter": None}, 404)

    @app.post("/api/v1/{kind}", include_in_schema=False)
    async def added(kind: str, request: Request) -> Any:
        if request.headers.get("content-type", "").startswith("multipart"):
            form = await request.form()
            sent = form["file"]
            assert not isinstance(sent, str)
            made.files[kind].append(str(sent.filename).rsplit(".", 1)[0])
            made.requests.append((kind, (await sent.read()).decode()))
            made.options[made.files[kind][-1]] = {name: value for name, value in form.items() if name != "file"}
            await sent.close()
            return {"name": made.files[kind][-1]}
        body = await request.json()
        made.requests.append((kind, body))
        if body.get("width") == -1:
            return JSONResponse({"error": "width is -1; use metres above 0.", "parameter": "width"}, 422)
        return JSONResponse({"id": "made", "name": body.get("name")}, 202)

    @app.get("/api/v1/tractors/{name}/summary")
    def tractor_summary(name: str) -> dict[str, Any]:
        return {"name": "Yanmar EG105" if name == "eg105" else name}

    @app.get("/api/v1/fields/{name}/summary")
    def summary(name: str) -> dict[str, Any]:
        shape = {"rings_m": [made_field.RING], "obstacles_m": [made_field.POND], "fences_m": []}
        told = {"area_ha": 0.72, "entrance_m": [0.0, 0.0], "remarks": [f"The field is called {name}."]}
        field = {"name": name} | shape | told
        return {"fields": [], "field": field, "error": None}


def _job(kind: str, name: str, status: str, made: Made) -> dict[str, Any]:
    error = "The field has no room for a track; use a narrower implement." if status == "failed" else None
    results = ["result.json", "result.csv", "page.html", "map.png", "plan.json", "plan-split-field-2.json"]
    asked = {"request": {"field": "north field", "width": 3, "tractors": "1-3"}, "created": "2026-11-20T09:00:00Z"}
    progress = {"done": made.polls, "all": 3, "words": "Simulating plans"}
    named = {"id": name, "kind": kind, "name": f"{kind} {NASTY}", "status": status, "error": error}
    return named | asked | {"progress": progress, "results": results}


def _forms(app: FastAPI) -> None:
    """The forms themselves, without files of a store."""

    @app.get("/api/v1/forms/plan")
    def plan_labels() -> dict[str, Any]:
        return build_plan_form().model_dump()

    @app.get("/api/v1/forms/{kind}")
    def example(kind: str) -> dict[str, Any]:
        return FORMS[kind](read_example_text(kind), [])

    @app.post("/api/v1/forms/{kind}")
    async def change(kind: str, request: Request) -> dict[str, Any]:
        body = await request.json()
        return FORMS[kind](body["text"], body["changes"])


def _estimates(app: FastAPI, made: Made) -> None:
    """A plan for each number of tractors up to the last digit, whose time and cost are those of an open plain."""

    @app.post("/api/v1/estimates")
    async def estimate(request: Request, at_once: bool = False) -> Any:
        body = await request.json()
        made.estimates.append(body)
        width_m, speed_kmh = body.get("width", 3.0), body.get("speed_kmh", 5.0)
        if not isinstance(width_m, (int, float)) or width_m <= 0.0:
            return JSONResponse({"error": f"width is {width_m}; use metres above 0.", "parameter": "width"}, 422)
        plans = [
            {"tractors": count, "feasible": True, "worked_pct": 98.0, "in_time": True if "deadline" in body else None}
            | {"time_s": 54000.0 / (width_m * speed_kmh * count), "cost": body.get("price_per_hour", 40.0) / width_m}
            for count in range(1, int(str(body["tractors"])[-1]) + 1)
        ]
        is_scaled = at_once and width_m != 3.0
        return {"recommended": len(plans), "plans": plans, "currency": None, "is_scaled": is_scaled}


def _jobs(app: FastAPI, made: Made) -> None:
    @app.get("/api/v1/{kind}/{name}/results/{result}")
    def result(kind: str, name: str, result: str) -> Any:
        if result == "page.html":
            return HTMLResponse(
                REPORT, headers={"content-security-policy": REPORT_SECURITY_POLICY, "x-frame-options": "SAMEORIGIN"}
            )
        return made_field.maps() if result == "maps.json" else made_field.result()

    @app.get("/api/v1/{kind}/{name}/results/{result}/export")
    def export(kind: str, name: str, result: str, to: str, tractor: int | None = None) -> Response:
        made.requests.append((f"{kind}/{name}/results/{result}/export", {"to": to, "tractor": tractor}))
        return Response(b"PK", headers={"content-disposition": f"attachment; filename*=UTF-8''plan-{to}.zip"})

    @app.post("/api/v1/{kind}/{name}/results/{result}/view")
    def view(kind: str, name: str, result: str) -> dict[str, str]:
        return {"path": f"{kind}/{name}/results/{result}"}

    @app.post("/api/v1/{kind}/{name}/cancel")
    def cancel(kind: str, name: str) -> Any:
        made.requests.append((f"{kind}/{name}/cancel", None))
        made.polls = -1
        return {}

    @app.delete("/api/v1/{kind}/{name}", status_code=204)
    def delete(kind: str, name: str) -> None:
        made.requests.append((f"{kind}/{name}/delete", None))

    @app.get("/api/v1/{kind}/{name}")
    def one(kind: str, name: str) -> Any:
        if kind == "events":
            return {"items": [EVENT]}
        if kind == "fleets":
            return _fleet() | {"videos": made.videos}
        made.polls += made.polls >= 0
        if made.polls < 0:
            return _job(kind, name, "cancelled", made)
        if name == "made" and made.polls < 3:
            return _job(kind, name, "running", made)
        return _job(kind, name, "failed" if name == "bad" else "done", made)


def _fleet() -> dict[str, Any]:
    named = {"id": "f1", "name": "North field, till", "created": "2026-11-20T08:00:00Z", "error": None}
    return named | {"recorded": True, "fleet": {"state": "running"}, "tractors": [{}, {}, {}]}


def _fleets(app: FastAPI, made: Made) -> None:
    @app.get("/api/v1/fleets/{fleet}/recording")
    def recording(fleet: str) -> Response:
        return Response(made_field.recording(), media_type="application/zip")

    @app.put("/api/v1/fleets/{fleet}/tractors/{tractor}/video")
    async def video(fleet: str, tractor: int, request: Request) -> Any:
        address = (await request.json())["address"]
        try:
            made.videos = {} if address is None else {tractor: check_video_address(address)}
        except ServiceError as refusal:
            return JSONResponse({"error": str(refusal), "parameter": "address"}, 422)
        return {"address": address}

    @app.post("/api/v1/fleets/{fleet}/stop")
    def stop(fleet: str) -> dict[str, Any]:
        made.requests.append((f"fleets/{fleet}/stop", None))
        return _fleet()

    @app.get("/api/v1/twins/{fleet}/{tractor}")
    def twin(fleet: str, tractor: int) -> dict[str, Any]:
        rows = [float(k) for k in range(60)]
        ahead, right = [0.03 * math.sin(k / 4) for k in rows], [0.02 * math.cos(k / 3) for k in rows]
        doubt = {"words": "The corrections are larger than noise explains, 9 cm across.", "since_s": 40.0}
        return {
            "corrections": {"time_s": rows, "ahead_m": ahead, "right_m": right},
            "doubt": doubt if tractor == 2 else None,
            "diagnosis": {"id": "old", "status": "done", "error": None} if made.diagnosed else None,
            "finding": made.finding if made.diagnosed else None,
        }

    @app.post("/api/v1/twins/{fleet}/{tractor}/diagnose")
    def diagnose(fleet: str, tractor: int) -> dict[str, Any]:
        made.diagnosed = True
        return {}

    @app.post("/api/v1/twins/{fleet}/{tractor}/mend")
    def mend(fleet: str, tractor: int) -> dict[str, Any]:
        made.finding = made.finding | {"extends_model": False}
        return {"tractor": "eg105 mended"}


async def _served(socket: WebSocket, made: Made, lanes: list[dict[str, Any]]) -> None:
    hello = await socket.receive_json()
    role = hello["role"] if hello.get("token") == CONTROL else "viewer"
    await socket.send_json(
        {"kind": "welcome", "fleet": "f1", "role": role, "settings": {"remote_mps": 1.4}, "heartbeat_s": 0.2}
    )
    await socket.send_json(made_field.scene())
    for number, lane in enumerate(lanes, start=1):
        until = [p for p, t in zip(lane["points_m"], lane["time_s"], strict=True) if t <= BEGUN_S]
        x, y, _ = made_field.place(lane, BEGUN_S)
        points = [[east + made_field.EAST, north + made_field.NORTH] for east, north in [*until, [x, y]]]
        await socket.send_json({"kind": "coverage", "tractor": number, "first": 0, "points": points})
    listening = asyncio.create_task(_listen(socket, made))
    begun, loop = asyncio.get_running_loop().time(), asyncio.get_running_loop()
    try:
        while not listening.done():
            if made.cut:
                return await socket.close()
            if made.silent:
                await asyncio.sleep(BEAT_S)
                continue
            now = BEGUN_S + loop.time() - begun
            await socket.send_json(_tick(lanes, now, made.state, made.area_m))
            await socket.send_json({"kind": "alarms", "items": _alarms(made)})
            await asyncio.sleep(BEAT_S)
    finally:
        listening.cancel()


def _alarms(made: Made) -> list[dict[str, Any]]:
    keys = ("id", "code", "related_number", "level", "tractor", "acknowledged", "over", "since", "sentence")
    silent = "Tractor 3 has not been heard of for 42 s; it finishes its released leg and stops."
    unread = "Tractor 2 stopped: it sees an obstacle that could not be read."
    moved_m = {POSITIONS: 0.0, SPEED: 2.0, PROGRESS: 2.0}
    lied = describe_doubt(1, MotionDoubt(POSITIONS, 2.0, moved_m, (0.0, 0.0, 0.0), 1.0))
    rows = [
        (1, "broken", None, "critical", 3, made.acknowledged, False, 1_790_000_000.0, silent),
        (2, "obstacle", 1, "warning", 2, "office", True, 1_790_000_100.0, f"An obstacle {NASTY} is on track 9."),
        (3, "unread obstacle", None, "critical", 2, None, made.looked, 1_790_000_200.0, unread),
    ]
    if made.area_m is not None:
        rows.append((4, "contradiction", None, "warning", 2, None, False, 1_790_000_300.0, lied))
    return [dict(zip(keys, row, strict=True)) for row in rows]


def _tick(lanes: list[dict[str, Any]], now: float, state: str, area_m: float | None = None) -> dict[str, Any]:
    done = {"eta_s": 1440.0, "done_pct": 41.7, "done_m2": 3004.0, "deadline_s": 3600.0, "probability": 0.93}
    rows = [_tick_tractor(number, lane, now, area_m) for number, lane in enumerate(lanes, start=1)]
    told = {"tractors": rows, "fleet": done | {"state": state}}
    return {"kind": "tick", "time": "2026-11-20T09:10:00.000Z"} | told


def _tick_tractor(number: int, lane: dict[str, Any], now: float, area_m: float | None) -> dict[str, Any]:
    gone = number == 3
    x, y, heading = made_field.place(lane, BEGUN_S - 40 if gone else now)
    east, north = made_field.EAST + x, made_field.NORTH + y
    place = {"easting_m": east, "northing_m": north}
    leg = sum(step["from_s"] + step["seconds"] <= now for step in lane["steps"])
    work = {"leg": leg, "leg_m": 3.0, "base_end": leg + 2, "done_pct": 40.0, "mode": "automatic"}
    waits = {"waits_for": [{"tractor": 1, "leg": 4}] if number == 2 else [], "holds": [], "holder": None}
    times = {"age_s": 42.0 if gone else 0.1, "eta_s": 1260.0 + 60 * number, "late_s": 95.0 if gone else 4.0}
    link = {"connection": "broken" if gone else "online", "speed_mps": 0.0 if gone else made_field.SPEED_MPS}
    errors = {"error_m": 0.03 + 0.02 * math.sin(now), "error_deg": 0.3 * math.cos(now)}
    twin = {"easting_m": east + 0.7, "northing_m": north + 0.3, "heading_deg": heading + 1.0}
    area = None if area_m is None or number != 2 else place | {"radius_m": area_m, "growth_mps": 1.0}
    told = place | {"tractor": number, "heading_deg": heading, "possible_area": area, "twin": twin}
    return told | work | waits | times | link | errors


async def _listen(socket: WebSocket, made: Made) -> None:
    while True:
        frame = await socket.receive_json()
        made.frames.append(frame)
        if frame["kind"] == "lease":
            made.holder = "me"
            mine = frame["takeover"]
            lease = {"tractor": frame["tractor"], "holder": "office" if mine else "the yard", "is_yours": mine}
            await socket.send_json({"kind": "lease"} | lease)
        elif frame["kind"] == "stop_all" and not made.deaf:
            await socket.send_json(SAID | {"what": "stop_all", "data": {}})
        elif frame["kind"] == "acknowledge" and frame["alarm"] == 3:
            made.looked = True
        elif frame["kind"] == "acknowledge":
            made.acknowledged = "office"
        elif frame["kind"] == "accept":
            made.state = "stopped"
            accepted = {"id": frame["proposal"], "state": "accepted", "without": [], "sentence": "", "tractors": []}
            await socket.send_json({"kind": "proposal"} | accepted)
        elif frame["kind"] == "replan":
            words = "Tractor 3 is left out. 0.28 of 0.42 ha are left to work."
            ready = {"id": 7, "state": "ready", "without": frame["without"], "eta_s": 1870.0, "tractors": []}
            await socket.send_json({"kind": "proposal", "sentence": words} | ready)
            await socket.send_json(SAID | {"what": "replan", "data": {"without": [3]}})
