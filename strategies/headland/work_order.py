"""When the headland is worked, as options offer it; imports nothing, so that help texts stay quick."""

HEADLAND_FIRST, HEADLAND_LAST = "first", "last"
HEADLAND_ORDERS = (HEADLAND_FIRST, HEADLAND_LAST)
