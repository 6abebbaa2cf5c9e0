"""Contact, payload and wrench on samples as they arrive."""
