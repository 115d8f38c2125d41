"""Who is in control: pure decisions."""
