"""Layout of pages, figures, tables, and words for numbers."""
