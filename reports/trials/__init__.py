"""The experiments of the thesis and tractor checks: tables, figures and pages."""
