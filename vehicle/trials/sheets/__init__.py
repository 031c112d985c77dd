"""The experiments of the thesis by name, each as a sheet: its numbers beside the printed ones, and pictures."""
