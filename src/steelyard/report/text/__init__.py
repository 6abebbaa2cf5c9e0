"""Numbers and sentences that pages and terminal share."""
