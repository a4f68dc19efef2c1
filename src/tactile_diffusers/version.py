"""The version of the package, read by pyproject.toml: written here and nowhere else."""

__version__ = "0.1.0"
