"""From compared hypotheses to findings: ranking, verdict, checks."""
