"""Model reduction: base parameters that the data can do without are removed one by one."""
