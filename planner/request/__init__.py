"""What is asked of a plan: its model, options and service points."""
