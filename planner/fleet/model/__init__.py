"""The plan, rules and states of a fleet, and its alarms."""
