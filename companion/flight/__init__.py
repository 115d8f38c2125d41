"""The flight process: who is in control, what ends it, and the loop itself."""
