"""Everything a request passes before a route: connection limits, rights, rates, forwarding to the back office, logs."""
