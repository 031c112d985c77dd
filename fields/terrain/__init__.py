"""Heights of a field: rasters and points are read, gridded in its plane, checked, and summed up as slopes."""
