"""Docstrings for the site: a section `Example:` with a doctest is one of code."""

import griffe


class Examples(griffe.Extension):
    """Renames the section as griffe knows it."""

    def on_object(self, *, obj: griffe.Object, **_: object) -> None:
        """Called for each module, class, function and attribute."""
        if obj.docstring is not None:
            obj.docstring.value = obj.docstring.value.replace("Example:\n", "Examples:\n")
