"""The field in local metres, with obstacles, fences, guidance lines and entrance, and conversions of coordinates."""
