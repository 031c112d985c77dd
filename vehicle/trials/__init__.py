"""The experiments of the thesis: drives with fixed or changing steering and along test paths, and what they show.

loop         the compiled loop: drive_tractor as in plans, every step recorded
drive        drives with given steering, on tyres of chapter 4 or the corrected base model; along a path
oversteer    the one criterion of stability
paths        the paths of the experiments
setting      the tractor as the experiments of chapters 3 and 4 drive it
deviation    distances between tracks, errors along a path
offsets, waves, navigation, fixed   the experiments: step response, zigzag, the real plan, fixed wheel angles
proving      drives that show whether a tractor file holds together
coupling     a virtual tractor kept to another one over a link (section 5.3)
design       tyres and the place of the centre of mass
thesis       the numbers the thesis prints
sheets       all of them as sheets, ours beside the thesis's, for reports
"""
