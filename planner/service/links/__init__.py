"""Tractors, operators and viewers of live fleets, over one WebSocket each; fleets and twins over HTTP.

frames       frames that come in, as models against which they are checked
told         frames that go out, as models by which they are documented
asyncapi     the document of these frames
converting   frames to reports of the centre and back
freshness    whether a remote command is of now
outbox       what waits to be sent to one client, with an end to it
clients      who is linked to a fleet, in which role
telling      scene, tick and alarms as frames
recording    what tractors reported, kept and given out as logs
warming      what is compiled on first use, used once
proposals    what is planned anew
twinning     one twin per tractor, advanced with the fleet
live         one live fleet: its centre, its clients, its clock
diagnosing   why twins are wrong: jobs, asked for or of their own accord, and what they found
hub          all live fleets, and what is worked out for them in a process of its own
link         the WebSocket
fleets       fleets over HTTP
twins        twins over HTTP
"""
