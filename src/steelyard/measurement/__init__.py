"""From a raw recording to clean motion on a uniform clock."""
