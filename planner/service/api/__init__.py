"""The service over HTTP, below /api/v1: the two apps, and routes for files, jobs, tokens, events and health."""
