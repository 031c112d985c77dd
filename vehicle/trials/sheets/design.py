"""Vehicle design (section 6.2) as sheets: stability and radius over tyres, and over the place of the centre of mass."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vehicle.tractor import Tractor
from vehicle.trials.design import SECONDS, STEERING_DEG, MassSweep, TyreMap, mass_sweep, tyre_maps
from vehicle.trials.fixed import BEST_GUESS, best_guess
from vehicle.trials.oversteer import GROWTH_DEG, LOST_DEG
from vehicle.trials.sheets.sheet import HeatMap, Line, Panel, Sheet, TextTable

CRITERION = (
    f"Oversteer: the slip of the rear axle passes {LOST_DEG:g} degrees, or over the last quarter of {SECONDS:g} s its "
    f"mean still lies more than {GROWTH_DEG:g} degrees above that of the quarter before."
)


def tyres(tractor: Tractor) -> Sheet:
    """Fig. 6.2: where the tractor is stable, and its radius, over front and rear tyres."""
    found = tyre_maps(tractor)
    sagging, closest = best_guess(tractor)
    other = tyre_maps(sagging, tyres=closest, shared_limit=True)
    tests: tuple[tuple[str, Callable[[TyreMap, TyreMap], bool]], ...] = (
        ("Rear grip decides stability: stable where the rear tyres hold more", lambda _, rear: _stable_upwards(rear)),
        ("The front must hold little: stable where its tyres hold less", lambda front, _: _stable_downwards(front)),
        ("Front grip decides the radius: it varies more than twofold", lambda front, _: _spread(front) > 2.0),
        ("Rear grip hardly touches the radius: within 10 %", lambda _, rear: _spread(rear) < 1.1),
        (
            "The radius is inversely proportional to the front's k and alpha_0, within 15 %",
            lambda front, _: _inverse(front),
        ),
        ("The fixed pair itself oversteers at 35 degrees", lambda front, _: not _fixed_pair(front)),
    )
    rows = tuple((text, _word(test(*found)), _word(test(*other))) for text, test in tests)
    counts = "; ".join(
        f"{name}: {int(front.stable.sum())} front and {int(rear.stable.sum())} rear tyres of {rear.stable.size}"
        for name, (front, rear) in (("stable here", found), ("with the closest hypothesis", other))
    )
    words = (
        f"{STEERING_DEG:g} degrees at 5 km/h on the tyres of section 4.3 (the fixed axle: front 5 degrees and 0.005, "
        "rear 5 degrees and 0.01), with the engine's friction curve. Radii are those of the centre of mass.",
        CRITERION,
        f"{counts[0].upper()}{counts[1:]}.",
        f"The closest hypothesis about Table 4.1: {BEST_GUESS}.",
    )
    maps = tuple(
        _map(one, f"{one.axle.capitalize()} tyres, {title}")
        for title, pair in (("the other axle fixed", found), ("closest hypothesis", other))
        for one in pair
    )
    header = ("Statement of section 6.2.1", "Here", "Closest hypothesis")
    return Sheet("tyres", "Tyres (Fig. 6.2)", words, (), maps, (TextTable("Statements", header, rows),))


def _map(found: TyreMap, title: str) -> HeatMap:
    x, y = np.array(found.limits_deg), np.array(found.slopes_per_deg)
    names = ("alpha_0 (degrees)", "k (per degree)", "Turning radius (m)")
    return HeatMap(title, *names, x, y, found.radius_m, "oversteer")


def _fixed_pair(front: TyreMap) -> bool:
    """Whether the tyres of section 4.3 are stable together."""
    return bool(front.stable[front.slopes_per_deg.index(0.005), front.limits_deg.index(5.0)])


def _stable_upwards(found: TyreMap) -> bool:
    """Once stable, stable for every larger slope and limit, and unstable somewhere."""
    stable = found.stable
    rows = (stable[1:] >= stable[:-1]).all() and (stable[:, 1:] >= stable[:, :-1]).all()
    return bool(rows and stable.any() and not stable.all())


def _stable_downwards(found: TyreMap) -> bool:
    stable = found.stable
    rows = (stable[1:] <= stable[:-1]).all() and (stable[:, 1:] <= stable[:, :-1]).all()
    return bool(rows and stable.any() and not stable.all())


def _spread(found: TyreMap) -> float:
    radii = found.radius_m[found.stable]
    return float(radii.max() / radii.min()) if len(radii) else np.nan


def _inverse(found: TyreMap) -> bool:
    """Radius times slope times limit alike over every stable cell."""
    product = (np.outer(found.slopes_per_deg, found.limits_deg) * found.radius_m)[found.stable]
    return bool(len(product) and np.abs(product / np.median(product) - 1.0).max() < 0.15)


def mass(tractor: Tractor) -> Sheet:
    """Fig. 6.3: radius and stability over the place of the centre of mass."""
    found = mass_sweep(tractor)
    sagging, closest = best_guess(tractor)
    other = mass_sweep(sagging, tyres=closest)
    rows = tuple(
        (text, _word(test(found)), _word(test(other)))
        for text, test in (
            ("A centre of mass to the rear stabilises: no place behind a stable one is unstable", _rear_stabilises),
            ("At 25 degrees every place is stable", lambda sweep: bool(np.isfinite(sweep.radius_m[0]).all())),
            ("At 30 degrees only the foremost places are unstable", _front_unstable),
            ("At 35 degrees every place is unstable", lambda sweep: bool(np.isnan(sweep.radius_m[2]).all())),
            ("At 25 degrees the radius falls as the centre of mass moves to the rear", _radius_falls),
        )
    )
    words = (
        "Tyres of section 4.3 (front 5 degrees and 0.005, rear 5 degrees and 0.01) at 5 km/h. The range of places is "
        "not printed. Radii are those of the centre of mass; a cross at the lower edge is an unstable place.",
        CRITERION,
        f"The second column repeats the sweep with the closest hypothesis about Table 4.1: {BEST_GUESS}.",
    )
    header = ("Statement of section 6.2.2", "Here", "Closest hypothesis")
    panels = (
        _radius_panel("Radius over the centre of mass", found),
        _radius_panel("The same with the closest hypothesis", other),
        _track_panel("Tracks at 35 degrees", found),
        _track_panel("Tracks at 35 degrees, closest hypothesis", other),
    )
    table = TextTable("Statements", header, rows)
    return Sheet("mass", "Centre of mass (Fig. 6.3)", words, (), panels, (table, _radius_table(found)))


def _word(good: bool) -> str:
    return "comes out" if good else "does not come out"


def _rear_stabilises(found: MassSweep) -> bool:
    stable = np.isfinite(found.radius_m)
    return bool((stable[:, 1:] >= stable[:, :-1]).all() and stable.any())


def _front_unstable(found: MassSweep) -> bool:
    """Unstable in front of some place in the front half, stable from there on."""
    stable = np.isfinite(found.radius_m[1])
    return bool(not stable[0] and stable[len(stable) // 2 :].all() and (stable[1:] >= stable[:-1]).all())


def _radius_falls(found: MassSweep) -> bool:
    radii = found.radius_m[0][np.isfinite(found.radius_m[0])]
    return bool(len(radii) > 1 and (np.diff(radii) < 0.0).all())


def _radius_panel(title: str, found: MassSweep) -> Panel:
    lines = tuple(
        Line(f"{angle:g} degrees", np.array(found.front_axle_m), radii, number)
        for number, (angle, radii) in enumerate(zip(found.angles_deg, found.radius_m, strict=True))
    )
    return Panel(title, "Centre of mass behind the front axle (m)", "Turning radius (m)", lines, missing="oversteer")


def _track_panel(title: str, found: MassSweep) -> Panel:
    lines = []
    for number, index in enumerate((0, 3, 6, 10)):
        track = found.tracks[index]
        place = track.place(0.0)
        label = f"{found.front_axle_m[index]:.1f} m"
        lines.append(Line(label, place[:, 0] - place[0, 0], place[:, 1] - place[0, 1], number))
    return Panel(title, "East (m)", "North (m)", tuple(lines), equal=True)


def _radius_table(found: MassSweep) -> TextTable:
    header = ("Behind the front axle", *(f"{angle:g} deg" for angle in found.angles_deg))
    rows = []
    for column, place in enumerate(found.front_axle_m):
        cells = ["oversteer" if np.isnan(radius) else f"{radius:.2f} m" for radius in found.radius_m[:, column]]
        rows.append((f"{place:.1f} m", *cells))
    return TextTable("Turning radius", header, tuple(rows))
