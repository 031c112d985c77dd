"""The headland in passes: how they are shared out, driven, and joined to the plan of a strategy."""
