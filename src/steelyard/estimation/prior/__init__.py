"""What is known of parameters before the data."""
