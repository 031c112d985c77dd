"""From logs to a diagnosis: the order of the work, and the figures of the answer.

The base is the tractor as its file gives it; every effect in the model is refitted with every other, and an effect
within the tolerance of its entry (`finest`) counts as a calibration of the file, not as a cause.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from vehicle.effects import CATALOGUE, SPEED, STEERING, Effect, effect
from vehicle.measured.bench import Bench, first_noise, prepare
from vehicle.measured.course import make_course
from vehicle.measured.curves import best_curve
from vehicle.measured.fitting import Fit, block_sums, empty_fit, linear_extra
from vehicle.measured.horizons import Squares, errors_of, floor_squares, run_squares, total_error
from vehicle.measured.knobs import Knobs, block_of, finest_of, knobs_for, settings_of
from vehicle.measured.naming import (
    LEAST_GAIN,
    Projector,
    Selection,
    deviation,
    is_nameable,
    retuned,
    robust_covariance,
    select,
    tried,
    without,
)
from vehicle.measured.nextdrive import next_drive
from vehicle.measured.noise import tuned
from vehicle.measured.record import Array, Log
from vehicle.measured.replay import Settings, make_rig
from vehicle.measured.verdict import EQUIVALENT, NAMED, NOT_VISIBLE, REFUTED, Diagnosis, Finding, finite
from vehicle.tractor import EffectSetting, Tractor

LOOK_ALIKE = 12.0
LOOK_ALIKE_SHARE = 0.02
ABOVE_UNNAMED = 2.0
WORTH_A_NAME_PCT = 0.5
DRAWS = 400
TRIAL_SHARES = (0.15, 0.3, 0.6, 1.0, 2.0)
Progress = Callable[[int, int], None]


def diagnose(logs: Sequence[Log], tractor: Tractor, ground: str, progress: Progress | None = None) -> Diagnosis:
    """What the simulation of a tractor gets wrong in these logs, why, and what mending it gains.

    `progress` is called with steps done and an estimate of all steps. Raises LogError when no stretch can be replayed
    and VehicleError for an unknown ground.
    """
    count = _Counter(progress)
    course = make_course(logs)
    rig = make_rig(tractor, ground, course.origin)
    bench = prepare(course, rig, {})
    bench = retuned(bench, empty_fit(bench))
    selection = select(bench, rig.tractor, lambda _: count.step())
    names = _nameable(selection, rig.tractor)
    best = selection
    if selection.unnamed:
        # What no cause explains may still be lessened by the catalogue: a calibration without a name.
        best = select(bench, rig.tractor, lambda _: count.step(), calibrate=True)
        names = [name for name in names if name in best.fit.settings]
    return _answer(logs, bench, selection, best, names, ground, count)


class _Counter:
    """Progress in steps; the whole is not known beforehand, so the estimate grows when it must."""

    def __init__(self, progress: Progress | None) -> None:
        self.progress, self.done, self.total = progress, 0, 100

    def step(self) -> None:
        """One step more."""
        self.done += 1
        self.total = max(self.total, self.done + 20)
        if self.progress:
            self.progress(self.done, self.total)

    def finish(self) -> None:
        """Everything is done."""
        if self.progress:
            self.progress(self.total, self.total)


def _answer(
    logs: Sequence[Log], base: Bench, selection: Selection, best: Selection, names: list[str], ground: str,
    count: _Counter,
) -> Diagnosis:  # fmt: skip
    bench, fit, tractor = best.bench, best.fit, base.rig.tractor
    floor = floor_squares(with_real_noise(bench, fit), fit.settings)
    others = held_out_settings(bench, fit)
    names = _worth_a_name(bench, names, others, floor)
    rivals = {name: _look_alikes(bench, fit, tractor, name) for name in names}
    count.step()
    kept = set(fit.settings) if selection.unnamed else set(names)
    held_out: dict[int, Settings] = {
        run: {name: values for name, values in one.items() if name in kept} for run, one in others.items()
    }
    before = run_squares(bench, {run: {} for run in range(len(base.course.names))})
    after = run_squares(bench, held_out)
    count.step()
    findings = _findings(bench, fit, tractor, names, rivals, floor, held_out, count)
    named = _in_order(bench, fit, [one.id for one in findings if one.status == NAMED])
    guilty, blocks = _blocks(base, bench, fit, named, findings, bool(selection.unnamed))
    count.finish()
    return Diagnosis(
        names=base.course.names,
        rows_used=base.course.rows,
        rows_gated=base.course.rows_read - base.course.rows,
        minutes=base.course.seconds / 60.0,
        ground=ground,
        before=errors_of(before),
        after=errors_of(after),
        floor=errors_of(floor),
        guilty_block=guilty,
        block_error=blocks,
        findings=tuple(findings),
        named=tuple(named),
        unexplained_share=unexplained(selection.bench, selection),
        depends_on=tuple(one.words for one in selection.unnamed),
        next_drive=next_drive(bench, fit, tractor, rivals),
        tractor=extended_tractor(bench, fit, sorted(kept)),
        calibration={name: fit.settings[name] for name in fit.settings if name not in names},
        curve=best_curve(bench, fit, named or list(rivals), selection.unnamed),
        notes=_notes(logs, bench),
    )


def _worth_a_name(bench: Bench, names: list[str], held_out: dict[int, Settings], floor: list[Squares]) -> list[str]:
    """Names whose effect lowers the error of whole replays too: what does not is the trace of a simplification."""
    final = total_error(run_squares(bench, held_out), floor)
    found = []
    for name in names:
        reduced: dict[int, Settings] = {
            run: {key: values for key, values in one.items() if key != name} for run, one in held_out.items()
        }
        if _gain(total_error(run_squares(bench, reduced), floor), final)[0] >= WORTH_A_NAME_PCT:
            found.append(name)
    return found


def with_real_noise(bench: Bench, fit: Fit) -> Bench:
    """The bench with the noise that the logs show, not the wider one that a wrong model may have been judged by."""
    plain = replace(bench, noise=first_noise(bench.course))
    return replace(plain, noise=tuned(plain, fit.settings))


def _nameable(selection: Selection, tractor: Tractor) -> list[str]:
    """Effects that may carry a name: clearly beyond tolerance, and not in the shadow of an unnamed dependence."""
    bench, fit = selection.bench, selection.fit
    names = [knobs.id for knobs, _ in fit.parts if is_nameable(bench, fit, tractor, knobs.id)]
    if not selection.unnamed:
        return names
    shadow = _unnamed_gain(fit) * ABOVE_UNNAMED
    apart = (STEERING, SPEED) if bench.has_wheel else ()
    return [name for name in names if block_of(name) in apart or without(bench, fit, name).loss - fit.loss > shadow]


def _unnamed_gain(fit: Fit) -> float:
    """Loss that the unnamed terms take away, the other coordinates following."""
    if fit.extra is None:
        return 0.0
    first = fit.slope.shape[1] - fit.extra.columns.shape[1]
    project = Projector(fit.slope[:, :first])
    removed = project(fit.extra.columns @ fit.extra.amounts)
    return float(removed @ removed)


def unexplained(bench: Bench, selection: Selection) -> float:
    """Share of the removable error that only unnamed terms remove: 0 when the catalogue explains it all."""
    fit = selection.fit
    gain = _unnamed_gain(fit)
    if gain <= 0.0:
        return 0.0
    first = bench.surprise({})
    whole = float(first @ first) - fit.loss
    return float(min(1.0, gain / max(whole, gain)))


def _look_alikes(bench: Bench, fit: Fit, tractor: Tractor, name: str) -> dict[str, dict[str, float]]:
    """Effects that explain as much in the place of a named one, with the values they would need."""
    rest = without(bench, fit, name)
    project = Projector(rest.slope)
    gain = rest.loss - fit.loss
    found = {}
    for entry in CATALOGUE:
        if entry.id in fit.settings or entry.id == "grip_patch":
            continue
        knobs = knobs_for(tractor, entry.id)
        other = tried(bench, rest, knobs, project)
        far = deviation(tractor, knobs, other.at)
        if other.gain > gain - LOOK_ALIKE - LOOK_ALIKE_SHARE * gain and far > finest_of(tractor, entry.id):
            found[entry.id] = knobs.values(other.at)
    return found


def held_out_settings(bench: Bench, fit: Fit) -> dict[int, Settings]:
    """Effects for every run as the other runs give them, by one step from the common fit."""
    runs = len(bench.course.names)
    sums = block_sums(bench, fit.slope, fit.surprise)
    found: dict[int, Settings] = {}
    for run in range(runs):
        kept = bench.block_runs != run
        step = np.zeros(fit.slope.shape[1])
        square = sums.squares[kept].sum(axis=0)
        if len(step) and _informed(square, sums.squares.sum(axis=0)):
            step = -np.linalg.solve(square, sums.sides[kept].sum(axis=0))
        parts, first = [], 0
        for knobs, at in fit.parts:
            parts.append((knobs, knobs.inside(at + step[first : first + knobs.count])))
            first += knobs.count
        found[run] = settings_of(parts)
    return found


def _informed(square: Array, whole: Array) -> bool:
    """Whether the other runs say enough to fit without this one."""
    return bool(np.all(np.diag(square) > 0.02 * np.diag(whole)) and np.linalg.cond(square) < 1e15)


def _findings(
    bench: Bench, fit: Fit, tractor: Tractor, names: list[str], rivals: dict[str, dict[str, dict[str, float]]],
    floor: list[Squares], held_out: dict[int, Settings], count: _Counter,
) -> list[Finding]:  # fmt: skip
    final = total_error(run_squares(bench, held_out), floor)
    alike = {other: name for name, others in rivals.items() for other in others}
    found = []
    for entry in CATALOGUE:
        count.step()
        others = rivals.get(entry.id, {})
        if entry.id in names:
            status = EQUIVALENT if others else NAMED
            found.append(_in_model(bench, fit, entry, status, tuple(others), rivals, floor, held_out, final))
        elif entry.id in alike:
            name = alike[entry.id]
            same = (name, *[one for one in rivals[name] if one != entry.id])
            found.append(_stand_in(entry, rivals[name][entry.id], same, fit.settings[name]))
        else:
            found.append(_absent(bench, fit, tractor, entry))
    return found


def _in_model(
    bench: Bench, fit: Fit, entry: Effect, status: str, others: tuple[str, ...],
    rivals: dict[str, dict[str, dict[str, float]]], floor: list[Squares], held_out: dict[int, Settings], final: Array,
) -> Finding:  # fmt: skip
    knobs, at = next(part for part in fit.parts if part[0].id == entry.id)
    reduced = {run: {k: v for k, v in one.items() if k != entry.id} for run, one in held_out.items()}
    worse = total_error(run_squares(bench, reduced), floor)
    gain, interval = _gain(worse, final)
    value = knobs.values(at)
    exchange = "; ".join(
        f"{_sized(entry, value)} looks like {_sized(effect(other), values)} of {other}"
        for other, values in rivals.get(entry.id, {}).items()
    )
    return Finding(
        entry.id, status, value, intervals(bench, fit, knobs, at), gain, interval,
        _visible(bench, fit, bench.rig.tractor, entry), entry.size.unit, entry.block, entry.words(value),
        others, exchange,
    )  # fmt: skip


def _sized(entry: Effect, value: dict[str, float]) -> str:
    return f"{value[entry.size.name]:.3g} {entry.size.unit}".strip()


def _stand_in(entry: Effect, value: dict[str, float], same: tuple[str, ...], of: dict[str, float]) -> Finding:
    exchange = f"looks like {_sized(effect(same[0]), of)} of {same[0]}"
    return Finding(
        entry.id,
        EQUIVALENT,
        value,
        None,
        0.0,
        None,
        None,
        entry.size.unit,
        entry.block,
        entry.words(value),
        same,
        exchange,
    )


def _absent(bench: Bench, fit: Fit, tractor: Tractor, entry: Effect) -> Finding:
    """An effect that is not in the model: refuted when its usual size would have shown."""
    smallest = _visible(bench, fit, tractor, entry)
    typical = entry.size.for_wheelbase(tractor.wheelbase_m).typical
    status = REFUTED if smallest is not None and smallest <= typical * 1.001 else NOT_VISIBLE
    return Finding(entry.id, status, None, None, 0.0, None, smallest, entry.size.unit, entry.block, "")


def _visible(bench: Bench, fit: Fit, tractor: Tractor, entry: Effect) -> float | None:
    """Smallest size, in the unit of the effect, whose trace in these logs would rise above chance and tolerance."""
    settings = {k: v for k, v in fit.settings.items() if k != entry.id}
    parts = [part for part in fit.parts if part[0].id != entry.id]
    bare = bench.surprise(settings)
    project = Projector(fit.slope[:, _others(fit, entry.id)])
    knobs = knobs_for(tractor, entry.id, _middle(bench))
    for share in TRIAL_SHARES:
        at = knobs.inside(np.array(knobs.neutral) + share * np.array(knobs.typical))
        trace = project(bench.change(settings_of([*parts, (knobs, at)]), bare, frozenset({entry.block})) - bare)
        strength = float(trace @ trace)
        if strength > 2.0 * LEAST_GAIN:
            if entry.id == "side_slip":
                return 1.0 / float(at[0])
            return finite(max(finest_of(tractor, entry.id), _smaller(share, strength) * knobs.typical[0]))
    return None


def _smaller(share: float, strength: float) -> float:
    """Share of the typical size at which the trace, growing with the square of the size, would just show."""
    return share * math.sqrt(2.0 * LEAST_GAIN / strength)


def _others(fit: Fit, name: str) -> npt.NDArray[np.int64]:
    keep = np.ones(fit.slope.shape[1], dtype=np.bool_)
    if name in fit.settings:
        keep[fit.columns(name)] = False
    return np.flatnonzero(keep)


def _middle(bench: Bench) -> tuple[float, float, float]:
    """A circle about the middle of the driving, a quarter of its spread wide."""
    east = np.concatenate([one.east for one in bench.course.stretches])
    north = np.concatenate([one.north for one in bench.course.stretches])
    radius = 0.25 * float(max(np.ptp(east), np.ptp(north)))
    origin = bench.course.origin
    return float(np.median(east)) + origin[0], float(np.median(north)) + origin[1], radius


def intervals(bench: Bench, fit: Fit, knobs: Knobs, at: Array) -> dict[str, tuple[float, float]]:
    """95 % intervals of an effect's values: the scatter between blocks, and the tolerance of the base tractor."""
    entry = effect(knobs.id)
    mine = fit.columns(knobs.id)
    sigma = np.sqrt(np.diag(robust_covariance(bench, fit))[mine])
    value = knobs.values(at)
    size = entry.size
    if knobs.id == "side_slip":
        wide = max(1.96 * float(sigma[0]), 0.12 * float(at[0]))
        return {"limit_g": (1.0 / (float(at[0]) + wide), 1.0 / max(float(at[0]) - wide, 0.2))}
    wide = math.hypot(1.96 * float(np.min(sigma)), finest_of(bench.rig.tractor, knobs.id))
    found = {size.name: (value[size.name] - wide, value[size.name] + wide)}
    if knobs.id == "cross_slope_drift":
        turn = math.degrees(min(wide / max(value["ratio"], 1e-9), math.pi))
        found["bearing_deg"] = (value["bearing_deg"] - turn, value["bearing_deg"] + turn)
    if knobs.id == "grip_patch":
        found |= {name: (value[name] - 2.0, value[name] + 2.0) for name in ("east_m", "north_m", "radius_m")}
    return found


def _gain(worse: Array, final: Array) -> tuple[float, tuple[float, float]]:
    """Percent of the error (root mean square) that an effect takes away, with a 90 % interval over runs."""
    rng = np.random.default_rng(11)
    drawn = rng.integers(0, len(worse), size=(DRAWS, len(worse)))
    shares = 100.0 * (1.0 - np.sqrt(final[drawn].sum(axis=1) / np.maximum(worse[drawn].sum(axis=1), 1e-12)))
    whole = 100.0 * (1.0 - math.sqrt(float(final.sum()) / max(float(worse.sum()), 1e-12)))
    return whole, (float(np.quantile(shares, 0.05)), float(np.quantile(shares, 0.95)))


def _in_order(bench: Bench, fit: Fit, named: list[str]) -> list[str]:
    """Most important first: by the loss that comes back without the effect."""
    return sorted(named, key=lambda name: -without(bench, fit, name).loss)


def _blocks(
    base: Bench, bench: Bench, fit: Fit, named: list[str], findings: list[Finding], unnamed: bool
) -> tuple[str | None, dict[str, tuple[float, float]]]:
    """The guilty block, and per channel cut at the sensors the surprise before and after (1 is noise alone)."""
    first, last = bench.surprise({}), linear_extra(bench.surprise(fit.settings), fit.extra)
    rows = base.course.rows
    cuts = {"wheel to path and antenna": slice(0, 3 * rows), "command to wheel": slice(3 * rows, 4 * rows),
            "speed": slice(4 * rows, 5 * rows)}  # fmt: skip
    found = {
        name: (float(np.sqrt(np.mean(first[cut] ** 2))), float(np.sqrt(np.mean(last[cut] ** 2))))
        for name, cut in cuts.items() if np.any(first[cut])
    }  # fmt: skip
    if named:
        return effect(named[0]).block, found
    alike = [one for one in findings if one.status == EQUIVALENT]
    if alike:
        return alike[0].block, found
    return ("wheel to path" if unnamed else None), found


def extended_tractor(bench: Bench, fit: Fit, names: Sequence[str]) -> Tractor:
    """The tractor with these effects of the fit, their intervals and the logs they came from."""
    effects = {}
    for knobs, at in fit.parts:
        if knobs.id in names:
            effects[knobs.id] = EffectSetting(
                value=knobs.values(at), interval=intervals(bench, fit, knobs, at), logs=bench.course.names
            )
    return bench.rig.tractor.model_copy(update={"effects": effects})


def _notes(logs: Sequence[Log], bench: Bench) -> tuple[str, ...]:
    """What the reader should know about the rows and columns."""
    found = []
    rules: dict[str, int] = {}
    for log in logs:
        for gate in log.gated:
            rules[gate.rule] = rules.get(gate.rule, 0) + gate.rows
    found += [f"{rows} rows left out: {rule}." for rule, rows in rules.items()]
    if not bench.has_wheel:
        found.append(
            "No wheel angle was logged: faults of the steering system and of the path cannot be told apart well."
        )
    if any(one.target is None for one in bench.course.stretches):
        found.append("No commanded speed was logged: the speed block was not looked at.")
    if any(not one.heading_seen for one in bench.course.stretches):
        found.append("No heading was logged: the course of the positions stands in for it.")
    if any((log.shuttle < 0).any() for log in logs):
        found.append("Rows driven in reverse were not used.")
    return tuple(found)
