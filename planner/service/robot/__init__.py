"""A simulated robot tractor, as a client of its own: what it does when, and the link it does it over.

driver    the tractor: frames and time in, states out, without a network
sending   states that wait to be acknowledged
client    the link, which comes back when it is lost
"""
