"""The service: plans, days and diagnoses as jobs, fleets that are driven, and the pages for people.

settings  what it is told when it starts
store     what survives it: database and bytes
jobs      long work in processes of its own
access    who may do what, and how much
api       all of it over HTTP
centre    the control centre of a fleet, without a network
links     tractors and operators over WebSocket, and fleets over HTTP
robot     a simulated tractor as a client
errors    its refusals
faults    what is wrong with values, in a sentence
"""
