"""What may happen to a flight, and what must hold."""
