"""The mathematics of identification: information, estimators, scores."""
