"""What a tractor's work takes: draft of implements, traction of wheels, fuel, and the energy of a run."""
