"""Sheet of the step response (section 3.2): Tables 3.1 to 3.3 and the findings about the steering simulators."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from vehicle.model.gnss import load_default_error_table
from vehicle.model.tractor import Tractor
from vehicle.trials.drive import UNLIMITED_M
from vehicle.trials.path_following import (
    FIRST_PATH_M,
    OFFSETS_CM,
    SECOND_PATH_M,
    SPEEDS_KMH,
    StepResponse,
    drive_step_response,
    measure_weaving_m,
)
from vehicle.trials.sheets.path_following import build_wheel_panel
from vehicle.trials.sheets.sheet import (
    TABLE_3_1,
    TABLE_3_2,
    TABLE_3_3,
    ExperimentSheet,
    PlotLine,
    PlotPanel,
    TextTable,
    ThesisComparison,
)

AGREEMENT_CM = 8.0
LENGTHS_M = (24.0, SECOND_PATH_M, 32.0, 40.0)
GROUNDS = ("asphalt", "soil")
Steps = dict[tuple[str, str, float, int], StepResponse]
NO_LOG = "needs a log of the real tractor, and none exists"


def build_step_sheet(tractor: Tractor, seed: int = 1) -> ExperimentSheet:
    """Tables 3.1, 3.2 and 3.3, and the plots of Fig. 3.2 to 3.5."""
    quiet = _drive_quiet(tractor)
    noisy = _drive_noisy(tractor, tractor.guidance.lateral_limit_m, seed)
    bare = _drive_noisy(tractor, UNLIMITED_M, seed)
    rows = _compare_table_3_1(quiet) + _compare_table_3_2(quiet) + _compare_table_3_3(noisy, bare)
    words = _describe_results(quiet, noisy, bare, tractor.guidance.lateral_limit_m)
    tables = (_build_path_length_table(tractor, noisy, seed), _build_weaving_table(tractor))
    title, panels = "Step response (Tables 3.1 to 3.3)", _build_panels(quiet)
    return ExperimentSheet("step", title, words, tuple(rows), panels, tables)


def _drive_quiet(tractor: Tractor) -> Steps:
    """All drives without GNSS errors, by ground, simulator, speed and offset."""
    return {
        (ground, steering, speed, offset): drive_step_response(tractor, offset, speed, ground, steering)
        for ground in GROUNDS
        for steering in ("proposed", "traditional", "none")
        for speed in SPEEDS_KMH
        for offset in OFFSETS_CM
    }


def _drive_noisy(
    tractor: Tractor,
    limit_m: float,
    seed: int,
    simulators: Sequence[str] = ("proposed", "traditional"),
    second_m: float = SECOND_PATH_M,
) -> Steps:
    """The drives of Table 3.3: on soil, each with its own GNSS errors."""
    errors = load_default_error_table()
    return {
        ("soil", steering, speed, offset): drive_step_response(
            tractor, offset, speed, "soil", steering,
            position_errors=errors, seed=1000 * seed + number, limit_m=limit_m, second_m=second_m,
        )
        for steering in simulators
        for speed in SPEEDS_KMH
        for number, offset in enumerate(OFFSETS_CM)
    }  # fmt: skip


def _build_path_length_table(tractor: Tractor, noisy: Steps, seed: int) -> TextTable:
    """Table 3.3 with other lengths of path 2: the remaining swing in the last 15 m outweighs the GNSS errors."""
    rows = []
    for length in LENGTHS_M:
        drives = noisy
        if length != SECOND_PATH_M:
            drives = _drive_noisy(tractor, tractor.guidance.lateral_limit_m, seed, ("proposed",), length)
        cells = [drive.mean_lateral_error_cm for key, drive in drives.items() if key[1] == "proposed"]
        inside = sum(2.0 <= cell <= 6.0 for cell in cells)
        rows.append((f"{length:g} m", f"{inside} of {len(cells)}", f"{min(cells):.1f} cm", f"{max(cells):.1f} cm"))
    title = "Table 3.3, proposed simulator, by the assumed length of path 2"
    return TextTable(title, ("Path 2", "Between 2 and 6 cm", "Smallest", "Largest"), tuple(rows))


def _compare_table_3_1(steps: Steps) -> list[ThesisComparison]:
    rows = []
    for (speed, kind), values in TABLE_3_1.items():
        for offset, thesis in zip(OFFSETS_CM, values, strict=True):
            bare = steps["asphalt", "none", speed, offset]
            difference_cm = steps["asphalt", "proposed", speed, offset].compute_difference_cm(bare)
            note = f"{NO_LOG}; our path differs by {difference_cm[kind == 'average']:.1f} cm from one without simulator"
            name = f"3.1 {speed} km/h {offset:+d} cm"
            rows.append(ThesisComparison(name, f"trajectory difference, {kind}", "cm", thesis, None, note))
    return rows


def _compare_table_3_2(steps: Steps) -> list[ThesisComparison]:
    rows = []
    for (steering, speed, kind), values in TABLE_3_2.items():
        for offset, thesis in zip(OFFSETS_CM, values, strict=True):
            traditional = steps["soil", "traditional", speed, offset]
            gap_cm = steps["soil", "proposed", speed, offset].compute_difference_cm(traditional)[kind == "average"]
            note = f"{NO_LOG}; our proposed and traditional simulators are {gap_cm:.1f} cm apart"
            name = f"3.2 {steering} {speed} km/h {offset:+d} cm"
            rows.append(ThesisComparison(name, f"trajectory difference, {kind}", "cm", thesis, None, note))
    return rows


def _compare_table_3_3(noisy: Steps, bare: Steps) -> list[ThesisComparison]:
    rows = []
    for (subject, speed), values in TABLE_3_3.items():
        steering = "traditional" if subject == "traditional" else "proposed"
        for offset, thesis in zip(OFFSETS_CM, values, strict=True):
            ours = noisy["soil", steering, float(speed), offset].mean_lateral_error_cm
            plain = bare["soil", steering, float(speed), offset].mean_lateral_error_cm
            note = f"lateral error limited to 0.7 m; with the plain Eq. 2.5 {plain:.1f} cm"
            if subject == "physical space":
                note = "real tractor against our proposed simulator; " + note
            name = f"3.3 {subject} {speed} km/h {offset:+d} cm"
            rows.append(ThesisComparison(name, "lateral error, average of last 15 m", "cm", thesis, ours, note))
    return rows


def _compute_gap_range(steps: Steps, size: int) -> tuple[float, float]:
    """Smallest and largest gap (cm) between the simulators on soil over the drives with an offset of this size."""
    gaps = []
    for speed, offset in itertools.product(SPEEDS_KMH, (-size, size)):
        traditional = steps["soil", "traditional", speed, offset]
        gaps.append(steps["soil", "proposed", speed, offset].compute_difference_cm(traditional)[0])
    return min(gaps), max(gaps)


def _build_weaving_table(tractor: Tractor) -> TextTable:
    """The plain and the limited Eq. 2.5 when the full offset applies at once."""
    limit = tractor.guidance.lateral_limit_m
    rows = []
    for offset in (50, 100, 150, 200):
        weaving = [measure_weaving_m(tractor, offset, limit_m=most) for most in (UNLIMITED_M, limit)]
        rows.append((f"{offset} cm", *(f"{metres:.2f} m" for metres in weaving)))
    title = "Started beside a straight path at 5 km/h on soil: largest lateral error in the third minute"
    header = ("Offset at the start", "Plain Eq. 2.5", f"Lateral error limited to {limit:g} m")
    return TextTable(title, header, tuple(rows))


def _describe_finding(quiet: Steps) -> str:
    """Whether the thesis's finding about the simulators is confirmed."""
    near, far = _compute_gap_range(quiet, 50)[1], _compute_gap_range(quiet, 100)[0]
    if near < AGREEMENT_CM < far:
        within = f"within {AGREEMENT_CM:g} cm"
        return f"Proposed and traditional simulators agree at 50 cm ({within}) and differ from 100 cm on."
    return "The thesis's finding that the simulators agree at 50 cm and differ from 100 cm on is not confirmed."


def _describe_results(quiet: Steps, noisy: Steps, bare: Steps, limit_m: float) -> tuple[str, ...]:
    limited_cm = [drive.mean_lateral_error_cm for key, drive in noisy.items() if key[1] == "proposed"]
    inside = sum(2.0 <= value <= 6.0 for value in limited_cm)
    plain = [drive.mean_lateral_error_cm for key, drive in bare.items() if key[1] == "proposed"]
    gaps = "; ".join(
        f"{size} cm: {low:.1f} to {high:.1f} cm"
        for size in (50, 100, 150, 200)
        for low, high in [_compute_gap_range(quiet, size)]
    )
    small = [drive for key, drive in quiet.items() if key[1] == "proposed" and abs(key[3]) == 50]
    slewing = sum(drive.enters_third_stage for drive in small)
    return (
        f"Path 1 of {FIRST_PATH_M:g} m, path 2 of {SECOND_PATH_M:g} m (the length is not printed and decides how much "
        "swing remains in the last 15 m), lookahead 5 m, controlled point 0.6 m behind the centre of mass.",
        f"Table 3.3: {inside} of {len(limited_cm)} cells are between 2 and 6 cm with the lateral error of Eq. 2.5 "
        f"limited to {limit_m:g} m ({min(limited_cm):.1f} to {max(limited_cm):.1f} cm), and "
        f"{sum(2.0 <= v <= 6.0 for v in plain)} with the plain law: from 2 m at 5 km/h the locked third stage may "
        f"carry the tractor past path 2 ({max(plain):.1f} cm).",
        f"{_describe_finding(quiet)} Largest distance between the two on soil: {gaps}.",
        f"The thesis supposes that the third stage is not entered at 50 cm; here it is entered in {slewing} of "
        f"{len(small)} drives of 50 cm.",
    )


def _build_panels(steps: Steps) -> tuple[PlotPanel, ...]:
    groups = {
        f"Paths on {ground}, 5 km/h": {
            f"{offset:+d} cm": steps[ground, "proposed", 5.0, offset] for offset in (-200, -100, -50, 50, 100, 200)
        }
        for ground in GROUNDS
    }
    for offset in (50, 100, 200):
        simulators = {name: steps["soil", name, 5.0, offset] for name in ("proposed", "traditional", "none")}
        groups[f"{offset} cm on soil, 5 km/h: three simulators"] = simulators
    panels = []
    for title, drives in groups.items():
        paths = {label: drive.trace.compute_path() for label, drive in drives.items()}
        lines = [PlotLine(label, xy[:, 1], 100 * xy[:, 0], number) for number, (label, xy) in enumerate(paths.items())]
        panels.append(PlotPanel(title, "Along the path (m)", "To the right (cm)", tuple(lines)))
    for name in ("proposed", "traditional"):
        trace = steps["soil", name, 5.0, 200].trace
        panels.append(build_wheel_panel(f"Wheel angle, {name}, 200 cm on soil, 5 km/h", trace, 9.0, 26.0))
    return tuple(panels)
