"""From a scenario to ranked plans: candidates, simulation on all cores, ranking; and the command line."""
