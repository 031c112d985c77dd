"""Reading logs: columns, rows that can be used, and conventions recognised and converted."""
