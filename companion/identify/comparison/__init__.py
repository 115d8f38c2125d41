"""Two identifications of one vehicle beside each other."""
