"""What a motion must keep at all times, and the proof that it does."""
