"""Work lines: the pieces of swaths and headland sides that a machine can work, each with the ground it covers."""
