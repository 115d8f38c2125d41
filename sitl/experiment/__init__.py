"""The paper's flights: flown, scored and drawn."""
