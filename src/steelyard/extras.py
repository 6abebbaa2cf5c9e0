"""Optional packages: the one line that installs a missing one."""

from importlib import import_module

from steelyard.errors import PackageError


def available(package: str) -> bool:
    """Whether an optional package can be imported."""
    try:
        import_module(package)
    except ImportError:
        return False
    return True


def require(package: str, extra: str, what: str, where: str) -> None:
    """Refuse what needs an optional package if that is not installed.

    Args:
        package: Name of the package.
        extra: Extra of steelyard that installs it.
        what: What needs it, such as "Parquet files".
        where: The file or attribute that asked for it.

    Raises:
        PackageError: It is not installed.
    """
    if not available(package):
        raise PackageError(
            f"{what} need the package {package}, which is not installed",
            where=where,
            fix=f'pip install {package}, or pip install ".[{extra}]" in the source of steelyard',
        )
