"""Robot files (TOML): sections, signals, gears, checks and edits."""
