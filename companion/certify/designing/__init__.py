"""What `companion design` chooses: reference model, adaptation, and PX4's settings that would allow more."""
