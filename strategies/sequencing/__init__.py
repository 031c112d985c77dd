"""The order in which tractors work their swaths: turn times, search and lower bounds."""
