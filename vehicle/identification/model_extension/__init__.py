"""Terms that lower the open-loop error where no cause is known, and the extended tractor."""
