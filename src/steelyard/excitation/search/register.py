"""Search methods by the name in a robot file; a new method is a class and a line here."""

from collections.abc import Mapping
from types import MappingProxyType

from steelyard.errors import DataError
from steelyard.excitation.search.methods import Gradient, Method
from steelyard.excitation.search.population import CmaEsSearch, GeneticSearch
from steelyard.suggest import advice

METHODS: Mapping[str, Method] = MappingProxyType(
    {"gradient": Gradient(), "genetic": GeneticSearch(), "cma_es": CmaEsSearch()}
)


def method_of(name: str) -> Method:
    """The method of a name.

    Raises:
        DataError: There is none.
    """
    if name not in METHODS:
        raise DataError(
            f"there is no search method '{name}'",
            where="[excitation.search] method",
            fix=advice(name, METHODS, "methods"),
        )
    return METHODS[name]
