"""Contact without a sensor."""
