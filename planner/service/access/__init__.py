"""Who may do what, and how much of it.

    who: Annotated[Who, Depends(needs("control"))]          # in a route
    who = who_of_socket(websocket, hello_token)             # in a socket, from a thread

guard     who asks, by token or from this machine; what they may
origin    pages of other sites are not listened to
limits    requests a minute and bytes of a body
views     results that may be looked at once without a token
headers   what every answer tells a browser to refuse
"""

from planner.service.access.guard import Who, needs, who_of_socket

__all__ = ["Who", "needs", "who_of_socket"]
