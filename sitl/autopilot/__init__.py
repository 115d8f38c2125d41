"""PX4's behaviour, without bytes."""
