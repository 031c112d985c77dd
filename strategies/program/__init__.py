"""What a strategy works with: the job it is given, the legs it writes, and the record that describes it."""
