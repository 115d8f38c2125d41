"""May it fly: what is checked before control is taken."""
