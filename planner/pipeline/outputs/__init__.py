"""What a planned run becomes: pictures, driving steps, guidance lines and saved plans."""
