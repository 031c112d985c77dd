"""Small files of farms, drawn by hand: what is in them is known."""

from pathlib import Path

LATITUDE, LONGITUDE = 48.0, 15.0
METRE_NORTH, METRE_EAST = 1.0 / 111_196.3, 1.0 / 74_625.5
"""Degrees of a metre at 48 degrees north, from the radii of curvature of WGS84."""
OUTER = ((0, 0), (300, 0), (300, 200), (0, 200))
INNER = ((100, 80), (140, 80), (140, 120), (100, 120))


def place(east_m: float, north_m: float) -> tuple[float, float]:
    """Latitude and longitude of a point so far from the corner of the field."""
    return LATITUDE + north_m * METRE_NORTH, LONGITUDE + east_m * METRE_EAST


def points(*metres: tuple[float, float], kind: str = "2") -> str:
    return "".join(
        f'<PNT A="{kind}" C="{latitude:.9f}" D="{longitude:.9f}"/>'
        for latitude, longitude in (place(east, north) for east, north in metres)
    )


def polygon(
    outer: str = "1", inner: str = "2", rings: tuple[tuple[tuple[float, float], ...], ...] = (OUTER, INNER)
) -> str:
    kinds = (outer, inner, *["2"] * 9)
    lines = "".join(f'<LSG A="{kind}">{points(*ring)}</LSG>' for kind, ring in zip(kinds, rings, strict=False))
    return f'<PLN A="1">{lines}</PLN>'


def pattern(name: str, kind: str, line: str, more: str = "") -> str:
    return f'<GGP A="GGP1"><GPN A="GPN1" B="{name}" C="{kind}" {more}><LSG A="5">{line}</LSG></GPN></GGP>'


def partfield(inside: str, name: str = "Long acre", area_m2: int = 58_400, key: str = "PFD1") -> str:
    return f'<PFD A="{key}" C="{name}" D="{area_m2}">{inside}</PFD>'


def taskdata(*inside: str, version: int = 4) -> str:
    root = f'<ISO11783_TaskData VersionMajor="{version}">{"".join(inside)}</ISO11783_TaskData>'
    return f'<?xml version="1.0" encoding="UTF-8"?>{root}'


def write_taskdata(folder: Path, text: str) -> Path:
    place = folder / "TASKDATA"
    place.mkdir(exist_ok=True)
    (place / "TASKDATA.XML").write_text(text, encoding="utf-8")
    return place


def agopengps(folder: Path, comma: bool = False) -> Path:
    """A field of 200 by 160 metres with two ponds, an AB line to the north and a curve."""
    place = folder / "Back forty"
    place.mkdir(exist_ok=True)

    def number(value: float) -> str:
        text = f"{value:.8f}"
        return text.replace(".", ",") if comma else text

    rings = [[(-100, -80), (100, -80), (100, 80), (-100, 80)], [(-50, 0), (-30, 0), (-30, 20), (-50, 20)],
             [(40, -20), (60, -20), (60, 0), (40, 0)]]  # fmt: skip
    lines = ["$Boundary"]
    for ring in rings:
        lines += ["False", str(len(ring)), *(f"{east:.3f},{north:.3f},0.00000" for east, north in ring)]
    (place / "Boundary.txt").write_text("\n".join(lines) + "\n")
    (place / "Field.txt").write_text(
        "2026-May-01 08:00:00 AM\n$FieldDir\nBack forty\n$Offsets\n0,0\nConvergence\n0\nStartFix\n"
        f"{number(42.03)},{number(-93.63)}\n"
    )
    (place / "TrackLines.txt").write_text(
        "$TrackLines\nAB north\n0\n6.000,0.000\n6.000,100.000\n0\n2\nTrue\n2\n6.000,0.000,0.0\n6.000,100.000,0.0\n"
        "Bend\n0.5\n0.0,0.0\n50.0,60.0\n0\n4\nTrue\n3\n0.0,0.0,0.0\n20.0,40.0,0.3\n50.0,60.0,0.9\n"
    )
    return place
