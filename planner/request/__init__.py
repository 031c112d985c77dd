"""What is asked of a plan: its model, options, uncertainty and service points."""
