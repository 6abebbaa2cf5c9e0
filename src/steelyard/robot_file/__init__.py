"""Robot files: a model in any format, its signals, and all settings of an identification."""
