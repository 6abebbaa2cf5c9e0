"""From compared readings to findings."""
