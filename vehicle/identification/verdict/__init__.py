"""The diagnosis: named and likely causes, findings, held-out errors, curves and the next drive."""
