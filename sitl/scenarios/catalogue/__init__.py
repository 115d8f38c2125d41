"""Every scenario, as data."""
