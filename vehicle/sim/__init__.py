"""The simulation of a plan: a compiled loop over pymunk bodies, and the checks for tractors that come too close."""
