"""External wrench without a sensor."""
