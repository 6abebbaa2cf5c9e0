"""Limits as margins with gradients, and proofs that a motion keeps them."""
