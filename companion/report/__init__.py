"""A flight on one page: what was recorded, what it was near to, and why it ended."""
