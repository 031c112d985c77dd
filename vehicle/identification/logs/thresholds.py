"""What is enough to say something of a log: numbers that several checks share, each with its reason."""

# Standard errors. What differs by chance once in twenty holds a claim back; once in four hundred it costs some data at
# most; once in sixteen thousand some hundred checks of a set of logs stay silent.
DOUBT_SIGMAS, CLEAR_SIGMAS, SURE_SIGMAS = 2.0, 3.0, 4.0
MEASURED_SIGMAS = 5.0  # where a correction is made, which a false alarm would carry into all that follows

# How many there must be: times to be no accident, events to have a rate, readings to have a median and a scatter, rows
# to show what is usual, rows to fit a line; chords (which overlap) to be no single swerve, to have a median, to fit a
# line.
FEWEST_TIMES, FEWEST_EVENTS, FEWEST_READINGS, FEWEST_ROWS, FEWEST_LINE_ROWS = 4, 10, 20, 50, 100
FEWEST_BEND_CHORDS, FEWEST_CHORDS, FEWEST_LINE_CHORDS = 5, 8, 12
FEWEST_PARTS = 6  # parts of driving that show what is usual

# Shares of what was looked at. Few: late rows and moments of gear change. Most: where the steering changes, some are
# misjudged. Steady: of a value that stays at its level. Nearly: within the tenth that estimates err by. Almost all: but
# for damaged rows.
FEW_SHARE, MAJORITY, MOST_SHARE, STEADY_SHARE, NEARLY_SHARE, ALMOST_ALL_SHARE = 0.1, 0.5, 0.8, 0.85, 0.9, 0.95
NEAR_SHARE = 0.4  # of what separates two values: nearer to one of them than to the other
ALIKE_SHARE = 0.3  # of a value: what differs from it by less is about the same, and what is less is no part to count
STRAY_CORRELATION = 0.3  # a tenth of the variance: no relation
CLEAR_CORRELATION = 0.7  # half of the variance; also the cosine of a heading that agrees with a course

STEEPEST_DEG = 60.0  # a tractor on such a slope has rolled over
MOVING_MPS = 0.3  # noise of a speed sensor at rest, and of the course of a creeping tractor
STANDSTILL_MPS = 0.1  # noise of a speed sensor at rest; larger negative speeds encode a direction
PATH_MPS = 0.4  # slower, the noise of positions and headings bends the path
GRID_S = 0.1  # of even grids on which instruments are compared, and of rows of simulated logs: the usual 10 Hz
READING_S = 1.0  # between two readings of the slowest column that is read, 1 Hz
MOMENT_S = 2.0 * READING_S  # what is nearer in time cannot be told apart with such a column
TURN_S = READING_S  # over which curvature is taken
PART_S = 5.0  # of driving, the least that counts as an observation of its own
WINDOW_S = 10.0  # of driving that shows a lag, or the level of a value; longer ones hold what drifts
LASTING_S = 3.0  # longer than bumps and late rows last: what contradicts so long is no accident
GAP_STEPS = 2.5  # times the usual step: rows are missing
BEND_PER_M = 0.06  # curvature from which the path is a bend
STRAIGHT_PER_M = 0.5 * BEND_PER_M  # beside which the antenna is hardly faster than the tractor
HOLDS = 4.0  # times the usual hold of a column: a value stands, or rows between two that were measured are missing
STANDING_FACTOR = 2.0  # times the usual hold, and the usual change after it: a value of a standing tractor
TURNED_DEG = 30.0  # of a course or a heading: more than drift, noise, and what a tractor turns between two rows
CLEARLY_APART_DEG = 5.0  # wheels that are elsewhere than they should be, beyond any offset
WHEEL_NOISE_DEG, POSITION_NOISE_M = 1.0, 0.03  # angles and places that differ by less may be one
JUMP_M = 0.5  # on top of what is driven: smaller steps between two positions are those of clods and of a poor receiver
STEERING_NOISE_DEG = 2.0 * WHEEL_NOISE_DEG  # the least that a steering column must move by, beyond a sensor's noise
STEERING_SPREAD_DEG = 1.5  # of wheels that stand, at most; and standard deviation of angles whose path shows anything
LOCK_QUANTILE = 0.998  # of the angles of a set of logs: all but spikes
SEED = 7  # of draws
