"""The commands of `headland`, one module each. Heavy imports stay inside the functions, so that help is quick."""
