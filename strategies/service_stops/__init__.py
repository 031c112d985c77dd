"""Service stops: where and when tractors are refilled or emptied, and orders of swaths found with their loads."""
