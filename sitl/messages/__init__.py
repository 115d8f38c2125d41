"""What PX4 says and answers."""
