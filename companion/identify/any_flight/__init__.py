"""From flight of any kind to the attitude response: stretches of it, the prediction-error method, what is enough."""
