"""One candidate: built, simulated, mended, measured; or told why it need not be.

evaluate          the whole of it
headland          its plans with rounds, of which the quickest stands
choosing, bounds  which plans of the same work are simulated; the least time a plan can take
alone             what its tractors drive with nobody else on the field, each way once
other_orders      what is tried where the order found first cannot be driven
refills           its plans with refills, and whether they went as planned
rivals, beaten    candidates that cannot win are told so with their bound
within_reach      tracks and rounds that no way leads to are left out
steady            whether the tractors kept to their ways
slowing, rerouting, turn_alone   turns that are better driven slowly, or another way, tried alone
"""
