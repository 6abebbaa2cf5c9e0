"""What the data say about the parameters: base parameters, information, the pass."""
