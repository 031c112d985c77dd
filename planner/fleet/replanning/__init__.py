"""New plans for the remaining work when tractors fail or obstacles appear."""
