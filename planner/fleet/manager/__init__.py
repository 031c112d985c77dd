"""The fleet manager: executes a plan with real tractors, and takes orders of operators."""
