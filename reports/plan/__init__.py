"""A ranking of plans: table, page, exports, map, leg lists; also fields and guidance files."""
