"""URDF files and Denavit-Hartenberg tables as mechanisms."""
