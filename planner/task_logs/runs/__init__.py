"""Runs: drives of tractors as task logs hold them, with their phases, the ground they worked and the files of both."""
