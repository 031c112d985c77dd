"""Numbers the thesis prints in chapters 3 and 4, as printed: centimetres, metres and degrees."""

from __future__ import annotations

OFFSETS_CM = (-200, -150, -100, -50, 50, 100, 150, 200)

# Trajectory difference between the digital twin and the real tractor: (speed, statistic) -> per offset.
TABLE_3_1 = {
    (3, "maximum"): (8.4, 8.7, 7.3, 8.3, 6.3, 6.6, 8.4, 9.2),
    (3, "average"): (3.7, 3.4, 3.3, 2.6, 2.6, 3.1, 4.5, 3.3),
    (5, "maximum"): (12.6, 7.8, 8.7, 5.0, 9.2, 6.5, 6.4, 11.5),
    (5, "average"): (5.0, 3.9, 2.9, 1.6, 2.9, 2.0, 1.8, 3.8),
}
TABLE_3_2 = {
    ("proposed", 3, "maximum"): (24.0, 10.7, 7.5, 9.4, 8.9, 9.1, 14.5, 14.6),
    ("proposed", 3, "average"): (11.6, 5.0, 2.8, 3.3, 3.8, 3.8, 7.1, 5.2),
    ("proposed", 5, "maximum"): (39.8, 10.8, 7.0, 7.4, 9.5, 8.1, 14.9, 21.6),
    ("proposed", 5, "average"): (16.4, 5.4, 2.8, 2.5, 4.3, 2.6, 4.5, 7.4),
    ("traditional", 3, "maximum"): (37.5, 20.7, 10.3, 11.1, 9.1, 15.7, 22.7, 23.6),
    ("traditional", 3, "average"): (13.9, 8.7, 4.9, 5.7, 4.0, 5.4, 8.9, 8.6),
    ("traditional", 5, "maximum"): (50.3, 33.7, 19.9, 9.7, 13.0, 23.4, 41.8, 44.9),
    ("traditional", 5, "average"): (23.0, 12.3, 5.7, 3.7, 6.3, 7.4, 12.2, 14.6),
}
# Average lateral error over the last 15 m of path 2.
TABLE_3_3 = {
    ("physical space", 3): (2.5, 2.4, 2.7, 2.5, 3.4, 3.0, 2.0, 1.8),
    ("physical space", 5): (1.5, 2.2, 2.3, 2.4, 3.6, 3.1, 2.1, 1.5),
    ("proposed", 3): (3.3, 3.2, 3.1, 3.6, 3.8, 4.3, 3.4, 3.8),
    ("proposed", 5): (3.6, 2.9, 2.5, 2.7, 4.0, 4.2, 3.0, 5.6),
    ("traditional", 3): (3.9, 3.1, 3.1, 3.2, 3.7, 4.0, 3.9, 3.9),
    ("traditional", 5): (5.1, 3.2, 2.5, 3.3, 4.3, 3.9, 4.6, 4.4),
}
# Physical space; the column of the digital twin is lost.
TABLE_3_4 = {
    (1, "lateral error, maximum", "cm"): 13.9,
    (1, "lateral error, average", "cm"): 5.2,
    (1, "heading error, maximum", "deg"): 3.8,
    (1, "heading error, average", "deg"): 1.49,
    (2, "lateral error, maximum", "cm"): 11.7,
    (2, "lateral error, average", "cm"): 2.3,
    (2, "heading error, maximum", "deg"): 2.2,
    (2, "heading error, average", "deg"): 0.52,
}
# What the text of section 3.4 gives of the lost column: twin less physical, per pass.
TWIN_APART = {("lateral error, average", "cm"): (2.0, 0.4), ("heading error, average", "deg"): (0.2, 0.14)}
# Radius in metres at 25, 30 and 35 degrees; None is oversteer.
TABLE_4_1: dict[str, tuple[float | None, ...]] = {
    "kinematic": (5.36, 4.53, 3.88),
    "linear": (5.89, 4.92, 4.19),
    "nonlinear": (7.30, 6.79, None),
}
# Lateral error (m) maximum and average, heading error (degrees) maximum and average.
TABLE_4_3 = {
    ("asphalt", "real"): (0.207, 0.107, 15.68, 7.86),
    ("asphalt", "nonlinear"): (0.203, 0.106, 15.67, 7.87),
    ("asphalt", "linear"): (0.201, 0.101, 15.44, 7.82),
    ("mud", "real"): (0.372, 0.167, 22.3, 9.12),
    ("mud", "nonlinear"): (0.369, 0.163, 23.5, 9.70),
    ("mud", "linear"): (0.271, 0.122, 20.2, 8.38),
}
MUD_RATIO = 0.163 / 0.122
