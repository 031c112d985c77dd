"""The experiments of the thesis, the fleet study and tractor checks: tables, figures and pages."""
