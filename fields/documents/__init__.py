"""Reading and writing of fields: what a name means, coordinate systems, and the field itself."""
