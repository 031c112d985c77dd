"""Plans of a day with several fields and fleets: who works which field, in what order, and how likely in time."""
