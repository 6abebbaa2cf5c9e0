"""The report: one self-contained page, and the terminal's summary."""
