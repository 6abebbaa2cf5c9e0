"""The commented robot file that `steelyard init` writes."""
