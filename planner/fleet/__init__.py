"""Live fleets without HTTP and database: fleet manager, safety, replanning, sessions and a simulated robot."""
