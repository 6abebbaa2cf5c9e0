"""Fields of terms that are not linear, found from data."""
