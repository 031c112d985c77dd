"""Plans as legs and gates, their files, and the record of a simulated plan."""
