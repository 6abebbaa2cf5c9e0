"""What an identified model is for."""
