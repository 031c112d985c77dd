"""One candidate: built, simulated, mended, measured; or told why it need not be.

evaluate          the whole of it
headland          its plans with rounds, of which the quickest stands
choosing, bounds  which plans of the same work are simulated; the least time a plan can take
rivals, beaten    candidates that cannot win are told so with their bound
within_reach      tracks and rounds that no way leads to are left out
steady, slowing   whether the tractors kept to their ways; turns that are better driven slowly, tried alone
"""
