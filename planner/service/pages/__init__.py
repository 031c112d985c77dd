"""The web pages of the service: static files, which use HTTP and links as any client does."""
