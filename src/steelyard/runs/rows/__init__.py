"""Rows repaired or left out before they are used: clock, outliers, rests."""
