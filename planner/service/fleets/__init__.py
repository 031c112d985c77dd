"""Live fleets over HTTP and WebSocket, and the client of simulated robots."""
