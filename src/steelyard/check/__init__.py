"""What is wrong with a log or its robot file, and the lines that correct it."""
