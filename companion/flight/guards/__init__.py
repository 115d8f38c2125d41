"""What ends control by itself."""
