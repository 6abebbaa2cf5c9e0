"""Many robots over many days: logs in parts, remembered sums, workers, and what changed when."""
