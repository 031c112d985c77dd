"""The step response of section 3.2: Tables 3.1 to 3.3 and the findings about the steering simulators."""

from __future__ import annotations

import numpy as np

from vehicle.gnss import default_table
from vehicle.tractor import Tractor
from vehicle.trials.offsets import FIRST_M, OFFSETS_CM, SECOND_M, SPEEDS_KMH, Step, step_response, weaving_m
from vehicle.trials.setting import UNLIMITED_M
from vehicle.trials.sheets.sheet import Comparison, Line, Panel, Sheet, TextTable
from vehicle.trials.thesis import TABLE_3_1, TABLE_3_2, TABLE_3_3

CLOSE_CM = 8.0
LENGTHS_M = (24.0, SECOND_M, 32.0, 40.0)
GROUNDS = ("asphalt", "soil")
Steps = dict[tuple[str, str, float, int], Step]
NO_LOG = "needs the real tractor's track, of which no log exists"


def step(tractor: Tractor, seed: int = 1) -> Sheet:
    """Tables 3.1, 3.2 and 3.3, and the pictures of Fig. 3.2 to 3.5."""
    quiet = _quiet(tractor)
    noisy = _noisy(tractor, tractor.guidance.lateral_limit_m, seed)
    bare = _noisy(tractor, UNLIMITED_M, seed)
    rows = _table_3_1(quiet) + _table_3_2(quiet) + _table_3_3(noisy, bare)
    words = _words(quiet, noisy, bare, tractor.guidance.lateral_limit_m)
    tables = (_lengths(tractor, noisy, seed), _weaving(tractor))
    return Sheet("step", "Step response (Tables 3.1 to 3.3)", words, tuple(rows), _panels(quiet), tables)


def _quiet(tractor: Tractor) -> Steps:
    """Every drive without GNSS error, by ground, simulator, speed and offset."""
    return {
        (ground, steering, speed, offset): step_response(tractor, offset, speed, ground, steering)
        for ground in GROUNDS
        for steering in ("proposed", "traditional", "none")
        for speed in SPEEDS_KMH
        for offset in OFFSETS_CM
    }


def _noisy(tractor: Tractor, limit_m: float, seed: int) -> Steps:
    """The drives of Table 3.3: soil, GNSS error, each with errors of its own."""
    return {
        ("soil", steering, speed, offset): step_response(
            tractor, offset, speed, "soil", steering, position_errors=default_table(), seed=1000 * seed + number,
            limit_m=limit_m,
        )
        for steering in ("proposed", "traditional")
        for speed in SPEEDS_KMH
        for number, offset in enumerate(OFFSETS_CM)
    }


def _lengths(tractor: Tractor, noisy: Steps, seed: int) -> TextTable:
    """Table 3.3 with other lengths of path 2: the swing left in the last 15 m outweighs the GNSS error."""
    rows = []
    for length in LENGTHS_M:
        cells = [drive.lateral_cm for key, drive in noisy.items() if key[1] == "proposed"]
        if length != SECOND_M:
            cells = [
                step_response(
                    tractor, offset, speed, "soil", position_errors=default_table(), seed=1000 * seed + number,
                    limit_m=tractor.guidance.lateral_limit_m, second_m=length,
                ).lateral_cm
                for speed in SPEEDS_KMH
                for number, offset in enumerate(OFFSETS_CM)
            ]  # fmt: skip
        inside = sum(2.0 <= cell <= 6.0 for cell in cells)
        rows.append((f"{length:g} m", f"{inside} of {len(cells)}", f"{min(cells):.1f} cm", f"{max(cells):.1f} cm"))
    title = "Table 3.3, proposed simulator, by the assumed length of path 2"
    return TextTable(title, ("Path 2", "Between 2 and 6 cm", "Smallest", "Largest"), tuple(rows))


def _table_3_1(steps: Steps) -> list[Comparison]:
    rows = []
    for (speed, kind), values in TABLE_3_1.items():
        for offset, thesis in zip(OFFSETS_CM, values, strict=True):
            apart = steps["asphalt", "proposed", speed, offset].difference_cm(steps["asphalt", "none", speed, offset])
            note = f"{NO_LOG}; the simulator moves our track by {apart[kind == 'average']:.1f} cm from none"
            name = f"3.1 {speed} km/h {offset:+d} cm"
            rows.append(Comparison(name, f"trajectory difference, {kind}", "cm", thesis, None, note))
    return rows


def _table_3_2(steps: Steps) -> list[Comparison]:
    rows = []
    for (steering, speed, kind), values in TABLE_3_2.items():
        for offset, thesis in zip(OFFSETS_CM, values, strict=True):
            one, other = steps["soil", "proposed", speed, offset], steps["soil", "traditional", speed, offset]
            apart = one.difference_cm(other)[kind == "average"]
            note = f"{NO_LOG}; our proposed and traditional simulators are {apart:.1f} cm apart"
            name = f"3.2 {steering} {speed} km/h {offset:+d} cm"
            rows.append(Comparison(name, f"trajectory difference, {kind}", "cm", thesis, None, note))
    return rows


def _table_3_3(noisy: Steps, bare: Steps) -> list[Comparison]:
    rows = []
    for (who, speed), values in TABLE_3_3.items():
        steering = "traditional" if who == "traditional" else "proposed"
        for offset, thesis in zip(OFFSETS_CM, values, strict=True):
            ours = noisy["soil", steering, float(speed), offset].lateral_cm
            plain = bare["soil", steering, float(speed), offset].lateral_cm
            note = f"lateral error limited to 0.7 m; with the plain Eq. 2.5 {plain:.1f} cm"
            if who == "physical space":
                note = "the real tractor beside our proposed simulator; " + note
            name = f"3.3 {who} {speed} km/h {offset:+d} cm"
            rows.append(Comparison(name, "lateral error, average of last 15 m", "cm", thesis, ours, note))
    return rows


def _apart(steps: Steps, size: int) -> tuple[float, float]:
    """Smallest and largest gap (cm) between the simulators on soil over the drives with an offset of this size."""
    gaps = [
        steps["soil", "proposed", speed, sign * size].difference_cm(steps["soil", "traditional", speed, sign * size])[0]
        for speed in SPEEDS_KMH
        for sign in (-1, 1)
    ]
    return min(gaps), max(gaps)


def _weaving(tractor: Tractor) -> TextTable:
    """The plain and the limited Eq. 2.5 when the whole offset is there at once."""
    limit = tractor.guidance.lateral_limit_m
    rows = tuple(
        (f"{offset} cm", *(f"{weaving_m(tractor, offset, limit_m=most):.2f} m" for most in (UNLIMITED_M, limit)))
        for offset in (50, 100, 150, 200)
    )
    title = "Started beside a straight path at 5 km/h on soil: largest lateral error in the third minute"
    return TextTable(title, ("Offset at the start", "Plain Eq. 2.5", f"Lateral error limited to {limit:g} m"), rows)


def _finding(quiet: Steps) -> str:
    """The thesis's finding about the simulators, or that it does not come out."""
    near, far = _apart(quiet, 50)[1], _apart(quiet, 100)[0]
    if near < CLOSE_CM < far:
        return f"Proposed and traditional simulators agree at 50 cm (within {CLOSE_CM:g} cm) and part from 100 cm on."
    return "That the simulators agree at 50 cm and part from 100 cm on does not come out."


def _words(quiet: Steps, noisy: Steps, bare: Steps, limit_m: float) -> tuple[str, ...]:
    mine = [drive.lateral_cm for key, drive in noisy.items() if key[1] == "proposed"]
    inside = sum(2.0 <= value <= 6.0 for value in mine)
    plain = [drive.lateral_cm for key, drive in bare.items() if key[1] == "proposed"]
    gaps = "; ".join(f"{size} cm: {low:.1f} to {high:.1f} cm" for size in (50, 100, 150, 200)
                     for low, high in [_apart(quiet, size)])  # fmt: skip
    small = [drive for key, drive in quiet.items() if key[1] == "proposed" and abs(key[3]) == 50]
    slewing = sum(drive.slews for drive in small)
    return (
        f"Path 1 of {FIRST_M:g} m, path 2 of {SECOND_M:g} m (the length is not printed and decides how much of the "
        "swing is left in the last 15 m); lookahead 5 m; the controlled point 0.6 m behind the centre of mass.",
        f"Table 3.3: {inside} of {len(mine)} cells lie between 2 and 6 cm with the lateral error of Eq. 2.5 limited to "
        f"{limit_m:g} m ({min(mine):.1f} to {max(mine):.1f} cm); with the plain law "
        f"{sum(2.0 <= v <= 6.0 for v in plain)} do: from 2 m at 5 km/h the locked third "
        f"stage may carry the tractor past path 2 ({max(plain):.1f} cm).",
        f"{_finding(quiet)} Largest distance between the two on soil: {gaps}.",
        f"The thesis supposes that at 50 cm the third stage is not entered; here it is in {slewing} of {len(small)} "
        "drives of 50 cm.",
    )


def _panels(steps: Steps) -> tuple[Panel, ...]:
    panels = []
    for ground in GROUNDS:
        lines = [
            Line(f"{offset:+d} cm", track.place()[:, 1], 100 * track.place()[:, 0], number)
            for number, offset in enumerate((-200, -100, -50, 50, 100, 200))
            for track in [steps[ground, "proposed", 5.0, offset].track]
        ]
        panels.append(Panel(f"Tracks on {ground}, 5 km/h", "Along the path (m)", "To the right (cm)", tuple(lines)))
    for offset in (50, 100, 200):
        three = {name: steps["soil", name, 5.0, offset].track for name in ("proposed", "traditional", "none")}
        lines = [Line(name, t.place()[:, 1], 100 * t.place()[:, 0], n) for n, (name, t) in enumerate(three.items())]
        panels.append(Panel(f"{offset} cm on soil, 5 km/h: three simulators", "Along the path (m)", "To the right (cm)",
                            tuple(lines)))  # fmt: skip
    for name in ("proposed", "traditional"):
        panels.append(_wheel_panel(f"Wheel angle, {name}, 200 cm on soil, 5 km/h", steps["soil", name, 5.0, 200]))
    return tuple(panels)


def _wheel_panel(title: str, drive: Step) -> Panel:
    """Command and wheel angle over time, the wheel angle in the colours of the stages."""
    track = drive.track
    part = (track.time_s > 9.0) & (track.time_s < 26.0)
    time = track.time_s[part]
    command, wheels = (np.degrees(track.column(name))[part] for name in ("command", "steering"))
    stages = track.column("stage")[part]
    lines = (Line("command", time, command, 3, True), Line("wheel angle", time, wheels, 0, False, stages))
    return Panel(title, "Time (s)", "Angle (degrees)", lines)
