"""What surrounds the vehicle: air, battery, estimator."""
