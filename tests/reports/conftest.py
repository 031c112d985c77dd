"""A drive, a ranking and a study of the kind the planner hands over, small and made by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from reports.common.plan_records import CellOutline, DriverLeg, HeadlandPassLine, PlanDrive, UnworkedPiece
from reports.common.plan_results import PlanRanking, PlanResult
from reports.trials.report import FleetStudy, ThesisClaim, ThesisTableRow

STEP_S = 0.5
SPEED_MPS = 1.5
WORKING, TURNING, WAITING, REVERSING = 1, 2, 3, 4
Stretch = tuple[int, list[tuple[float, float]]]


def _sampled(stretches: list[Stretch], wait_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and statuses every STEP_S along stretches at SPEED_MPS, after waiting at the start."""
    count = round(wait_s / STEP_S)
    points = [np.repeat([stretches[0][1][0]], count + 1, axis=0).astype(float)]
    states = [np.full(count + 1, WAITING)]
    for state, corners in stretches:
        line = np.asarray(corners, dtype=float)
        along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))))
        at = np.linspace(0.0, along[-1], max(round(along[-1] / SPEED_MPS / STEP_S), 1) + 1)[1:]
        points.append(np.column_stack([np.interp(at, along, line[:, k]) for k in (0, 1)]))
        states.append(np.full(len(at), state))
    return np.vstack(points), np.concatenate(states).astype(np.int64)


def _back_and_forth(rows: list[float], west: float, east: float) -> list[Stretch]:
    """Swaths at heights `rows`, joined by half circles, the last turn of each pair by backing up."""
    stretches: list[Stretch] = []
    for index, y in enumerate(rows):
        a, b = (west, east) if index % 2 == 0 else (east, west)
        stretches.append((WORKING, [(a, y), (b, y)]))
        if index + 1 == len(rows):
            break
        side, rise = (1.0 if b == east else -1.0), rows[index + 1] - y
        if index % 3 == 2:
            back = b - side * 2.0
            stretches.append((TURNING, [(b, y), (b + side * 4.0, y + 2.0)]))
            stretches.append((REVERSING, [(b + side * 4.0, y + 2.0), (b + side * 4.0, y - 3.0)]))
            stretches.append((TURNING, [(b + side * 4.0, y - 3.0), (b, y + rise), (back, y + rise)]))
            stretches.append((REVERSING, [(back, y + rise), (b, y + rise)]))
        else:
            arc = [math.pi * k / 12 - math.pi / 2 for k in range(13)]
            half = [(b + side * rise / 2 * math.cos(t), y + rise / 2 * (1 + math.sin(t))) for t in arc]
            stretches.append((TURNING, half))
    return stretches


@pytest.fixture
def drive() -> PlanDrive:
    """Three tractors on 270 m x 70 m with a pond, 24 swaths of 3 m."""
    rows = [0.5 + 3.0 * k for k in range(23)]
    shares = [rows[:8], rows[8:16], rows[16:]]
    driven = [_sampled(_back_and_forth(share, 12.0, 258.0), 20.0 * k) for k, share in enumerate(shares)]
    seconds = {
        name: tuple(float((status == code).sum()) * STEP_S for _, status in driven)
        for name, code in (("working", 1), ("turning", 2), ("waiting", 3), ("reversing", 4))
    }
    return PlanDrive(
        title="Iwamizawa: 3 tractors, split-field, omega",
        boundary=np.array([[0.0, -1.0], [270.0, -1.0], [272.0, 70.0], [-1.0, 69.0]]),
        holes=(np.array([[120.0, 28.2], [128.0, 28.2], [128.0, 29.8], [120.0, 29.8]]),),
        swaths=np.array([[[12.0, y], [258.0, y]] for y in rows]),
        width_m=3.0,
        step_s=STEP_S,
        xy=tuple(xy for xy, _ in driven),
        status=tuple(status for _, status in driven),
        finish_s=tuple((len(xy) - 1) * STEP_S for xy, _ in driven),
        seconds=seconds,
        entrance=(-1.0, 69.0),
    )


def _plan(rank: int, strategy: str, count: int, turn: str, time_s: float, **more: object) -> PlanResult:
    given: dict[str, object] = {
        "tractor_time_s": time_s * count, "cost": 0.011 * time_s * count / 10, "meets_deadline": time_s <= 3600.0,
        "worked_pct": 98.7, "overlap_pct": 1.254, "outside_m": 0.0, "outside_along_m": 0.0, "turning_s": 61.0 * count,
        "waiting_s": 12.5 * (count - 1), "reversals": 3 * count, "measured": {"formation_pct": 12.5, "folding_s": None},
        "min_clearance_m": math.inf if count == 1 else 2.345678912, "collisions": 0,
    }  # fmt: skip
    return PlanResult(strategy, count, turn, True, None, rank, time_s, **(given | more))  # type: ignore[arg-type]


@pytest.fixture
def ranking() -> PlanRanking:
    """Six plans that work, three in time for the deadline one hour after the start, and four refused."""
    plans = (
        _plan(1, "row-by-row", 5, "omega", 1253.0, on_pareto_front=True),
        _plan(2, "col-by-col", 5, "omega", 1290.0),
        _plan(3, "split-field", 3, "switch-back", 1712.4, on_pareto_front=True),
        _plan(4, "interleaved", 2, "omega", 3725.0, on_pareto_front=True),
        _plan(5, "split-field", 1, "u", 4475.0, on_pareto_front=True),
        _plan(6, "split-field", 1, "switch-back", 5012.0),
        PlanResult("row-by-row", 7, "u", False, "Turning radius 4.10 m needs 8.20 m, rows are 10.00 m apart."),
        PlanResult("row-by-row", 9, "u", False, "Turning radius 4.10 m needs 8.20 m, rows are 12.00 m apart."),
        PlanResult("col-by-col", 7, "omega", False, "Tractors 2 and 3 touch.", time_s=933.0, collisions=1),
        PlanResult("split-field", 11, "omega", False, "The field has 8 swaths, too few for 11 tractors."),
    )
    return PlanRanking(
        field_name="Iwamizawa",
        area_ha=1.89,
        seed=7,
        plans=plans,
        start="08:00",
        deadline="09:00",
        allowed_s=3600.0,
        assumptions=("Working width 3.00 m.", "Turning radius 4.10 m on soil."),
    )


@pytest.fixture
def leaving(ranking: PlanRanking) -> PlanRanking:
    """The same with what every plan that works leaves open: a tenth of the field, those with 5 tractors a fifth."""
    piece = UnworkedPiece(1200.0, 131.4, 64.6, 141.75, 43.2)
    plans = tuple(
        replace(
            plan,
            worked_pct=100.0 * share,
            missed_m2=18_900.0 * (1 - share),
            largest_missed=piece,
            finished_s=(plan.time_s or 0.0) / share,
            finished_cost=(plan.cost or 0.0) / share,
            wheel_traffic_m2=12.4,
            outside_m=1.2,
            outside_along_m=31.2,
        )
        if plan.feasible and (share := 0.8 if plan.tractors == 5 else 0.9)
        else plan
        for plan in ranking.plans
    )
    return replace(ranking, plans=plans)


@pytest.fixture
def open_drive(drive: PlanDrive) -> PlanDrive:
    """The drive with two strips of 10 m by 60 m and 5 m by 20 m left open, the first with 2 m by 5 m worked in it."""
    strip = np.array([[2.0, 2.0], [12.0, 2.0], [12.0, 62.0], [2.0, 62.0]])
    island = np.array([[5.0, 30.0], [5.0, 35.0], [7.0, 35.0], [7.0, 30.0]])
    other = np.array([[250.0, 40.0], [255.0, 40.0], [255.0, 60.0], [250.0, 60.0]])
    piece = UnworkedPiece(590.0, 8.0, 20.0)
    return replace(drive, unworked=(strip, island, other), largest_missed=piece, missed_m2=690.0)


@pytest.fixture
def still_drive(drive: PlanDrive) -> PlanDrive:
    """One moment of the drive, on its field without tracks."""
    first = {"xy": tuple(xy[:1] for xy in drive.xy), "status": tuple(status[:1] for status in drive.status)}
    return replace(drive, swaths=np.empty((0, 2, 2)), holes=(), entrance=None, **first)


@pytest.fixture
def listed_drive(drive: PlanDrive) -> PlanDrive:
    """The drive with two rounds, two cells, an obstacle, names of tracks and what each tractor does."""
    ring = np.array([[3.0, 2.0], [267.0, 2.0], [267.0, 66.0], [3.0, 66.0], [3.0, 2.0]])
    west, east = (np.array([[x, 10.0], [x + 100.0, 10.0], [x + 100.0, 60.0], [x, 60.0]]) for x in (20.0, 140.0))
    steps = tuple(
        (
            DriverLeg("wait", None, "", 0.0, 20.0, 0.0, 12.0, 0.5, for_tractors=(1,))
            if tractor
            else DriverLeg("round", 1, "1", 0.0, 20.0, 30.0, 12.0, 0.5, is_headland_pass=True, bearing_deg=90.0),
            DriverLeg("track", 8 * tractor + 1, "", 20.0, 160.0, 240.0, 135.0, 0.5, bearing_deg=90.0),
            DriverLeg(
                "turn", 8 * tractor + 2, "", 180.0, finish - 180.0, 12.0, 258.0, 2.0, over_swaths=1, shape="omega"
            ),
        )
        for tractor, finish in enumerate(drive.finish_s)
    )
    return replace(
        drive,
        headland_passes=(HeadlandPassLine(1, ring), HeadlandPassLine(2, ring * 0.97 + 1.0)),
        headland_sides=(HeadlandPassLine(1, ring, "R1"), HeadlandPassLine(2, ring * 0.97 + 1.0, "R2")),
        cells=(CellOutline(1, 90.0, (west,), 70.0, 35.0), CellOutline(2, 12.4, (east,), 190.0, 35.0)),
        obstacles=(np.array([[121.0, 28.5], [127.0, 28.5], [127.0, 29.5]]),),
        swath_names=tuple(f"{number}a" for number in range(1, len(drive.swaths) + 1)),
        steps=steps,
    )


@pytest.fixture
def study() -> FleetStudy:
    """A study with one row of every kind."""
    return FleetStudy(
        tables={
            "6.1": (
                ThesisTableRow("one tractor", 1, 4475.0, 4612.5, 3.0726, ""),
                ThesisTableRow("formation", 3, 1530.0, 1499.0, -2.0261, ""),
            ),
            "6.2": (ThesisTableRow("apart", 3, 1253.0, None, None, "not consistent with Table 6.1, not tuned to"),),
            "6.3": (ThesisTableRow("row-by-row", 5, 1253.0, 1240.2, -1.0215, ""),),
        },
        claims=(
            ThesisClaim("1 to 9 tractors are ever faster.", True, "Each count beats the one before."),
            ThesisClaim("11 tractors are slower than 9.", False, "Here 11 need 12:01 and 9 need 12:22."),
        ),
        assumptions=("Headlands of 10 m at both ends lie inside the field.", "One set for every row."),
    )
