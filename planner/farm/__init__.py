"""The farm file: what a farm owns and pays, in one TOML file that all commands use."""
