"""What outlives the server: the database with its migrations, bytes by SHA-256, backup and restore."""
