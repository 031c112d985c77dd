"""The guide: its pages as Markdown, and files that they show or install."""
