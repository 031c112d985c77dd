"""A field of 120 m x 60 m and three tractors on it, made by hand: legs, paths in time, maps, recordings."""

import io
import math
import zipfile
from typing import Any

WIDTH_M, SPEED_MPS, EAST, NORTH = 3.0, 1.5, 500_000.0, 4_700_000.0
RING = [[0.0, 0.0], [120.0, 0.0], [126.0, 58.0], [60.0, 62.0], [-4.0, 57.0]]
POND = [[70.0, 24.5], [78.0, 24.0], [79.0, 29.0], [72.0, 30.0]]
ROWS, COUNT = 6, 3
Point = list[float]


def legs_of(tractor: int) -> list[dict[str, Any]]:
    """Tracks with turns between them, of tractor 1 to 3, in metres of the field."""
    found = []
    for row in range(ROWS):
        y, ahead = 4.5 + WIDTH_M * (ROWS * (tractor - 1) + row), row % 2 == 0
        a, b = ([10.0, y], [110.0, y]) if ahead else ([110.0, y], [10.0, y])
        number = ROWS * (tractor - 1) + row
        found.append({"kind": "track", "number": number, "piece": 0, "gear": 1, "implement": True, "points_m": [a, b]})
        if row + 1 < ROWS:
            side = 1.0 if ahead else -1.0
            arc = [math.pi * k / 12 - math.pi / 2 for k in range(13)]
            bend = [[b[0] + side * 3.0 * math.cos(t), y + WIDTH_M / 2 * (1 + math.sin(t))] for t in arc]
            turn = {"kind": "turn", "number": number + 1, "piece": 0, "gear": 1, "implement": False}
            found.append(turn | {"points_m": bend})
    return found


def lane_of(tractor: int) -> dict[str, Any]:
    """Knots in time of a tractor that begins 15 s after the one before."""
    points: list[Point] = []
    status: list[int] = []
    time, at = [0.0], 15.0 * (tractor - 1)
    steps = []
    for leg in legs_of(tractor):
        begun = at
        for k, point in enumerate(leg["points_m"]):
            if not points:
                points.append(point)
                if at:
                    time.append(at)
                    points.append(point)
                    status.append(3)
            elif k:
                at += math.dist(point, points[-1]) / SPEED_MPS
                time.append(at)
                points.append(point)
                status.append(1 if leg["implement"] else 2)
        words = f"track {leg['number'] + 1}" if leg["implement"] else f"turn to track {leg['number'] + 1}"
        steps.append({"from_s": begun, "seconds": at - begun, "words": words})
    return {"time_s": time, "points_m": points, "status": status, "steps": steps}


def place(lane: dict[str, Any], at: float) -> tuple[float, float, float]:
    """Where a tractor is: metres of the field, and heading in degrees."""
    time, points = lane["time_s"], lane["points_m"]
    k = max(i for i, one in enumerate(time) if one <= at or i == 0)
    k = min(k, len(points) - 2)
    share = min(max((at - time[k]) / max(time[k + 1] - time[k], 1e-9), 0.0), 1.0)
    (x, y), (u, v) = points[k], points[k + 1]
    return x + share * (u - x), y + share * (v - y), math.degrees(math.atan2(u - x, v - y)) % 360


def maps() -> dict[str, Any]:
    """What maps.json of a plan holds: two plans, one with three tractors and one with two."""
    lanes = [lane_of(number) for number in range(1, COUNT + 1)]
    worked = [leg for number in range(1, COUNT + 1) for leg in legs_of(number) if leg["implement"]]
    tracks = [{"name": str(leg["number"] + 1), "points_m": leg["points_m"]} for leg in worked]
    missed = [[110.0, 50.0], [120.0, 50.0], [121.0, 57.0], [111.0, 57.0]]
    outline = {"boundary_m": RING, "holes_m": [], "obstacles_m": [POND], "fences_m": [RING[:2]], "missed_m": [missed]}
    work = {"width_m": WIDTH_M, "swaths": tracks, "headland_passes": [], "entrance_m": [0.0, 0.0]}
    ground = outline | work

    def plan(count: int) -> dict[str, Any]:
        end_s, title = max(lane["time_s"][-1] for lane in lanes[:count]), f"split-field, {count} tractors"
        named = {"strategy": "split-field", "tractors": count, "title": title}
        return named | {"end_s": end_s, "lanes": lanes[:count]} | ground

    return {"field": "north field", "begin": None, "plans": [plan(3), plan(2)]}


def result() -> dict[str, Any]:
    """What result.json of a plan holds, as far as a page reads it."""
    rows = [("split-field", 3, 470.0), ("split-field", 2, 655.0), ("interleaved", 3, 690.0)]
    ground = {"turn": "u", "feasible": True, "worked_pct": 98.2, "missed_m2": 71.4, "min_clearance_m": 1.9}
    others = {"meets_deadline": None, "finish_probability": 0.93, "remark": None, "reason": None, "turning_s": 96.0}
    plans: list[dict[str, Any]] = [
        {"rank": rank, "strategy": name, "tractors": count, "time_s": time_s, "finished_s": time_s + 9.0}
        | {"cost": count * time_s / 90.0, "expected_cost": count * time_s / 80.0, "p80_s": time_s * 1.1}
        | {"waiting_s": 15.0 * count}
        | ground
        | others
        for rank, (name, count, time_s) in enumerate(rows, start=1)
    ]
    reason = "Three tractors abreast have no room to turn on a headland of 9 m."
    refused = {"rank": None, "strategy": "row-by-row", "tractors": 3, "feasible": False, "reason": reason}
    told = {"is_simulated": False, "keeps_clearance": True, "bound_s": 900.0}
    not_tried = {**refused, **told, "strategy": "col-by-col", "reason": "skipped: by estimate it is slower"}
    too_near = {**not_tried, "strategy": "interleaved", "keeps_clearance": False, "bound_s": None}
    return {
        "field": {"name": "north field", "area_ha": 0.72},
        "scenario": {"tractor": "Yanmar EG105", "clearance_m": 0.5},
        "plans": [*plans, refused, not_tried, too_near],
        "best": plans[0],
        "summary": ["Three tractors with split-field are done in 0:07:50; one fewer takes 3 min more."],
    }


def recording() -> bytes:
    """A zip of one log a tractor."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for number in range(1, COUNT + 1):
            lane, rows = lane_of(number), ["time_s,easting_m,northing_m,heading_deg,speed_mps,steering_command_deg"]
            for second in range(0, int(lane["time_s"][-1]), 2):
                x, y, heading = place(lane, second)
                pose, steering = f"{EAST + x:.3f},{NORTH + y:.3f},{heading:.2f}", f"{4 * math.sin(second):.2f}"
                rows.append(f"{second},{pose},{SPEED_MPS},{steering}")
            archive.writestr(f"tractor-{number}.csv", "\n".join(rows) + "\n")
    return packed.getvalue()


def scene() -> dict[str, Any]:
    """The scene of a fleet, in metres of its grid."""

    def shifted(points: list[Point]) -> list[Point]:
        return [[x + EAST, y + NORTH] for x, y in points]

    bale = {"id": 4, "name": "bale", "polygon_m": shifted([[30.0, 40.0], [33.0, 40.0], [32.0, 43.0]])}
    ring = shifted(RING)
    ground = {"field": [ring], "field_obstacles": [shifted(POND)], "fence": [ring], "obstacles": [bale]}
    tractors = [
        {"tractor": number, "max_steering_deg": 28.0}
        | {"legs": [{**leg, "points_m": shifted(leg["points_m"])} for leg in legs_of(number)]}
        for number in range(1, COUNT + 1)
    ]
    grid = {"crs": "EPSG:32654", "origin_m": [EAST, NORTH], "width_m": WIDTH_M}
    return {"kind": "scene", "version": 1, "deadline_s": None, "tractors": tractors} | grid | ground
