"""Models with names for tables and pictures."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from steelyard.estimation.identified import IdentifiedModel, load_model

Given = str | Path | IdentifiedModel
"""A model, its `model.json`, or the folder that contains it."""


def named_models(models: Sequence[Given] | Mapping[str, Given]) -> dict[str, IdentifiedModel]:
    """Models by distinct names: those given, or those of their files or folders.

    A model that is neither is called by its number, `model 1`.
    """
    if isinstance(models, Mapping):
        return {str(name): load_model(model) for name, model in models.items()}
    names = [_name(model, number) for number, model in enumerate(models, start=1)]
    if len(set(names)) < len(names):
        names = [f"{name} ({k})" for k, name in enumerate(names, 1)]
    return {name: load_model(each) for name, each in zip(names, models, strict=True)}


def _name(model: Given, number: int) -> str:
    if isinstance(model, IdentifiedModel):
        return f"model {number}"
    path = Path(model).absolute()
    if path.name == "model.json":
        return path.parent.name
    return path.stem if path.suffix == ".json" else path.name
