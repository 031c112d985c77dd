"""What commands share: options, files to read and write, output on a terminal."""
