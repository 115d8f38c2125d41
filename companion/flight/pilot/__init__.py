"""What is flown: mission, doublets, controller."""
