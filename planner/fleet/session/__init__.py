"""Sessions of live fleets: clients, frames, twins and recordings."""
