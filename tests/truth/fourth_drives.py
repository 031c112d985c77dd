"""Programmes of the fourth reference: besides the known one, drives whose angles, speeds and lengths are drawn."""

import numpy as np

from tests.truth.drives import Array, Drive, constant, drive, stairs, three_speeds_programme

PROGRAMMES = ("three_speeds", "drawn", "lines", "right_only", "one_speed", "lawn")
SLOW, ROAD, FAST = 0.85, 1.4, 2.2


def build_programme(name: str, seed: int) -> list[Drive]:
    """The runs of a programme, some of them drawn from the seed. Raises ValueError for a name not in PROGRAMMES."""
    rng = np.random.default_rng([seed, 43])
    if name == "three_speeds":
        return [run.mirrored() if rng.random() < 0.5 else run for run in three_speeds_programme()]
    builders = {"drawn": draw_field_day, "lines": draw_lines, "right_only": draw_right_only,
                "one_speed": draw_one_speed, "lawn": draw_lawn}  # fmt: skip
    if name not in builders:
        raise ValueError(f"The programme {name!r} is unknown; use one of: {', '.join(PROGRAMMES)}.")
    return builders[name](rng)


def draw_turns(
    rng: np.random.Generator, name: str, side: int, speeds: tuple[float, ...], seconds: float = 60.0
) -> Drive:
    """Growing bends to one side (0: to both in turn), each held long enough to be steady, at changing speed."""
    count = int(rng.integers(6, 9))
    sizes = np.sort(rng.uniform(2.0, 26.0, count))
    signs = np.full(count, side) if side else np.where(np.arange(count) % 2, 1, -1)
    hold = seconds / count
    paces = [(seconds / 4.0, float(rng.choice(speeds))) for _ in range(4)]
    return drive(name, seconds, stairs(*[(hold, float(angle)) for angle in sizes * signs]), stairs(*paces))


def draw_steps(rng: np.random.Generator, name: str, most: float, hold_s: float, speed: float) -> Drive:
    """Steps to angles drawn up to a size, back over the middle as often as not."""
    count = int(58.0 / hold_s)
    angles = rng.uniform(-most, most, count)
    return drive(name, 58.0, stairs(*[(hold_s, float(angle)) for angle in angles]), speed)


def draw_line(
    rng: np.random.Generator, name: str, bearing: float, speeds: tuple[float, ...], tool: bool = False
) -> Drive:
    """A line kept to by the autosteer, with steps aside and changes of speed."""
    offsets = stairs(*[(10.0, float(size)) for size in rng.uniform(-0.9, 0.9, 6)])
    paces = stairs(*[(20.0, float(rng.choice(speeds))) for _ in range(3)])
    down = stairs((20.0, 0.0), (20.0, 1.0), (20.0, 0.0)) if tool else 0.0
    return drive(name, 58.0, offsets, paces, down, bearing_deg=bearing, closed_loop=True)


def draw_waves_drive(rng: np.random.Generator, name: str, speed: float, tool: bool = False) -> Drive:
    """Two sines on top of each other, and slow enough reversals for play to show."""
    low, high = rng.uniform(0.05, 0.08), rng.uniform(0.15, 0.3)
    size, small = rng.uniform(4.0, 9.0), rng.uniform(0.8, 2.0)
    down = stairs((30.0, 0.0), (30.0, 1.0)) if tool else 0.0

    def steer(time: Array) -> Array:
        wave: Array = size * np.sin(2.0 * np.pi * low * time) + small * np.sin(2.0 * np.pi * high * time)
        return wave

    return drive(name, 60.0, steer, speed, down)


def draw_field_day(rng: np.random.Generator) -> list[Drive]:
    """Nine runs of about a minute in all of which something is drawn: bends, steps, waves, straights, lines."""
    bearing, paces = float(rng.uniform(0.0, 360.0)), (SLOW, ROAD, FAST)
    straight = stairs((20.0, ROAD), (19.0, FAST), (19.0, SLOW))
    return [
        drive("out", 58.0, constant(0.0), straight, stairs((30.0, 0.0), (28.0, 1.0)), bearing_deg=bearing),
        drive("home", 58.0, constant(0.0), straight, stairs((30.0, 1.0), (28.0, 0.0)), bearing_deg=bearing + 180.0),
        draw_turns(rng, "right_bends", 1, paces),
        draw_turns(rng, "left_bends", -1, paces),
        draw_steps(rng, "large_steps", 24.0, 4.8, ROAD),
        draw_steps(rng, "small_steps", 2.2, 3.6, ROAD),
        draw_waves_drive(rng, "waves", ROAD, True),
        draw_waves_drive(rng, "slow_waves", SLOW),
        draw_line(rng, "line", bearing + 90.0, paces, True),
    ]


def draw_lines(rng: np.random.Generator) -> list[Drive]:
    """Eight runs along lines in four directions, all steered by the autosteer, and two of bends to turn round."""
    bearing, paces = float(rng.uniform(0.0, 360.0)), (SLOW, ROAD, FAST)
    lines = [draw_line(rng, f"line_{k}", bearing + 90.0 * k, paces, k % 2 == 1) for k in range(6)]
    return [*lines, draw_turns(rng, "turn_right", 1, paces), draw_turns(rng, "turn_left", -1, paces)]


def draw_right_only(rng: np.random.Generator) -> list[Drive]:
    """Bends to the right and nothing else."""
    return [draw_turns(rng, f"right_{k}", 1, (SLOW, ROAD, FAST)) for k in range(5)]


def draw_one_speed(rng: np.random.Generator) -> list[Drive]:
    """All at one speed, to both sides."""
    pace = float(rng.uniform(1.2, 1.9))
    bends = [draw_turns(rng, f"bends_{k}", side, (pace,)) for k, side in enumerate((1, -1, 0))]
    steps = [draw_steps(rng, "steps", 20.0, 5.0, pace), draw_steps(rng, "fine_steps", 3.0, 4.0, pace)]
    return [*bends, *steps, draw_waves_drive(rng, "waves", pace)]


def draw_lawn(rng: np.random.Generator) -> list[Drive]:
    """A lawn tractor: bends both ways, steps, and lines of its own autosteer."""
    paces = (0.6, 0.9, 1.3)
    bends = [draw_turns(rng, f"lawn_bends_{k}", side, paces, 80.0) for k, side in enumerate((1, -1, 0, 0))]
    lines = [draw_line(rng, f"lawn_line_{k}", 90.0 * k, paces) for k in range(2)]
    return [*bends, draw_steps(rng, "lawn_steps", 20.0, 7.0, 0.9), *lines]
