"""What all reports share: result types of plans, wording, tables that fit the console, templates."""
