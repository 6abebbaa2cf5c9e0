"""The fit of a model to logs, and what varies it: bootstrap, sensitivity, repetition."""
