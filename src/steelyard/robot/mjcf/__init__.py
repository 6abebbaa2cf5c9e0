"""MJCF files, compiled by MuJoCo, as mechanisms."""
