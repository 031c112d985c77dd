"""One run replayed: what was measured, what the simulation makes of the same commands, and the error by horizon."""

from __future__ import annotations

from vehicle.measured.bench import Bench, first_noise
from vehicle.measured.course import make_course
from vehicle.measured.horizons import HORIZONS_S, anchored, chain, errors_of, pieces, run_squares
from vehicle.measured.logs import read_log
from vehicle.measured.replay import make_rig
from vehicle.measured.verdict import Replayed, ReplayedStretch
from vehicle.tractor import load_tractor


def replayed(log: str, tractor: str, ground: str, fixes: tuple[str, ...] = ()) -> Replayed:
    """Replay a log with the effects of the tractor file. Raises LogError and VehicleError."""
    machine = load_tractor(tractor)
    run = read_log(log, fixes, machine.wheelbase_m)
    course = make_course([run])
    bench = Bench(course, make_rig(machine, ground, course.origin), first_noise(course), (), (), ())
    settings = {name: dict(one.value) for name, one in machine.effects.items()}
    errors = errors_of(run_squares(bench, {0: settings}))
    return Replayed(run.name, machine.name, tuple(settings), errors, _stretches(bench, settings), run.rows_gated)


def _stretches(bench: Bench, settings: dict[str, dict[str, float]]) -> tuple[ReplayedStretch, ...]:
    found = []
    for stretch in bench.course.stretches:
        antenna, heading, wheel, speed = chain(bench, stretch, settings)
        turned, shift = _fit(stretch, antenna)
        moved = antenna @ turned.T + shift
        long = [rows for h in HORIZONS_S[1:2] for rows in pieces(stretch.time, h)]
        parts = [(rows, anchored(stretch, antenna, heading, rows)) for rows in long]
        found.append(ReplayedStretch(stretch, moved, wheel, speed, tuple(parts)))
    return tuple(found)


def _fit(stretch, antenna):  # type: ignore[no-untyped-def]
    """Turn and shift that lay the simulated start (5 s) on the measured one."""
    import numpy as np

    rows = slice(0, max(int(np.searchsorted(stretch.time, 5.0)), 2))
    p = np.stack([stretch.east[rows], stretch.north[rows]], axis=1)
    q = antenna[rows]
    a, b = p - p.mean(axis=0), q - q.mean(axis=0)
    angle = np.arctan2(np.sum(b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0]), np.sum(a * b))
    turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return turned, p.mean(axis=0) - turned @ q.mean(axis=0)
