"""A day of several fields and fleets: tables, exports, pictures and page."""
