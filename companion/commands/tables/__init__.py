"""What the commands print of what they found."""
