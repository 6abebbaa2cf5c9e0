"""What is done with single rows: validity, clock, outliers, saturation, resampling."""
