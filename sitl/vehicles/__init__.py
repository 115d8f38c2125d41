"""Vehicle physics, pure."""
