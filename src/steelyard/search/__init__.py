"""Search by populations, for criteria without slopes."""
