"""From logs to an identified model: what the commands do, without a command line."""
