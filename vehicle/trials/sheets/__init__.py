"""The experiments of the thesis as sheets for reports: numbers beside the printed ones, plots and tables."""
