"""Programs as machine code, and its cache."""
