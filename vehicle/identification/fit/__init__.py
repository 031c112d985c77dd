"""Least-squares fits of effects to residuals and to the open-loop error."""
