"""The attitude response: its kinds, its exact realisation as a linear system, and its discretisation."""
