"""Names of a package that are imported when they are first asked for."""

import importlib
import sys


def importing(package, modules):
    """The `__getattr__` of a package, `package`; `modules`: module, from the package where it has a dot -> names."""
    places = {name: module for module, names in modules.items() for name in names}

    def get(name):
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        found = getattr(importlib.import_module(places[name], package), name)
        setattr(sys.modules[package], name, found)
        return found

    return get
