"""Programs compiled to machine code, and the cache of machine code."""
