"""The robot as the dynamics see it: bodies, joints, inertias, transmission, loops."""
