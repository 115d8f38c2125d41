"""What every search for a proof is built of: bisection, and the conic solver."""
