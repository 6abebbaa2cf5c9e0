"""Small errors of geometry and of readings as columns beside the model."""
