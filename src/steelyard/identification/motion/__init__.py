"""Motion that is designed, simulated or tracked."""
