"""The package as the site reads it: its docstrings, and rooms that functions are named after."""

import griffe


class Examples(griffe.Extension):
    """A section `Example:` with a doctest is one of code; names of the package hide no room."""

    def on_module_members(self, *, mod: griffe.Module, **_: object) -> None:
        """Called when the names of a module are known, before its modules are read.

        Pages name functions by their modules. `steelyard.export` is then the room.
        """
        if mod.path == "steelyard":
            mod.members = {name: one for name, one in mod.members.items() if not one.is_alias}

    def on_object(self, *, obj: griffe.Object, **_: object) -> None:
        """Called for each module, class, function and attribute."""
        if obj.docstring is not None:
            obj.docstring.value = obj.docstring.value.replace("Example:\n", "Examples:\n")
