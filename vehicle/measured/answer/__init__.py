"""From logs to an answer: status per effect, the plot that shows a cause, the drive that decides."""
