"""What surprises in logs, given the instruments and the soil."""
