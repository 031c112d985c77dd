"""Jobs: their requests and input files, the worker processes that run them, and the fair queue for reading files."""
