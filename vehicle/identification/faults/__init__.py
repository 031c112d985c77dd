"""What breaks during a run, and runs that are unlike the others."""
