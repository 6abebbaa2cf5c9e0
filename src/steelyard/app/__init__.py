"""The guided app: a workspace of a folder, its steps in a browser, long work in processes."""
