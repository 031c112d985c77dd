"""The clocks of columns: which rows of each were measured, and how old, held or smoothed a column is."""
