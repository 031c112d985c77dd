"""Uploaded files are read in processes that are confined by limits, Landlock and seccomp."""
