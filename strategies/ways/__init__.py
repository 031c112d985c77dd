"""Ways: how a tractor gets from one pose to another. Known to no job and no strategy above.

paths, turns     geometry of turns in closed form
sizing           the headland that turns need
words, search    the words that join two poses, and the best that fits, compiled
chains           the quickest chain of poses of such a way, compiled
reach            whether rings lead there at all, asked before, compiled
routes, connect  the quickest drivable way between two poses inside the field
finders          such searches kept for several layouts of a field
bends, around    lines bent round small obstacles; tracks bent, or cut where no bend fits
gateway          the way through the entrance of a field
fence, rubbing   whether the whole machine stays inside a fence on a way; followed step by step, compiled
"""
