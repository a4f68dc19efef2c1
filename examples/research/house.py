"""How large the package is, and how its files hang together: `python house.py [REPOSITORY]`.

Prints lines and files under src, lines of tests, the lines that an import reaches, long functions and files, and
circles of imports. Code is read, not run. `import tactile_diffusers` counts what Python loads at once; the training
script counts imports inside functions too, because a reader follows both.
"""

import argparse
import ast
import json
from pathlib import Path

PACKAGE = "tactile_diffusers"
LONGEST_BODY, LONGEST_FILE = 60, 400


def lines(path):
    return len(path.read_text(encoding="utf-8").splitlines())


class House:
    """The modules of the package and what they import of each other.

    Args:
        root (`Path`): of the repository.
    """

    def __init__(self, root):
        self.root, self.source = root, root / "src"
        self.files = sorted((self.source / PACKAGE).rglob("*.py"))
        self.modules = {self.name(path): path for path in self.files}

    def name(self, path):
        parts = path.relative_to(self.source).with_suffix("").parts
        return ".".join(part for part in parts if part != "__init__")

    def imported(self, path, inside_functions=True):
        """Files of the package that a file imports, without the packages' own `__init__`."""
        own = self.name(path).split(".") if self.source in path.parents else []
        package = own if path.name == "__init__.py" else own[:-1]
        tree = ast.parse(path.read_text(encoding="utf-8"))
        nodes = ast.walk(tree) if inside_functions else _outside_functions(tree)
        for node in nodes:
            if isinstance(node, ast.Import):
                targets = [(alias.name, None) for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                base = package[: len(package) - node.level + 1] if node.level else []
                module = ".".join([*base, *(node.module or "").split(".")]).strip(".")
                targets = [(module, alias.name) for alias in node.names]
            else:
                continue
            for module, name in targets:
                for candidate in (f"{module}.{name}", module):
                    if candidate in self.modules:
                        yield self.modules[candidate]
                        break

    def reached(self, start, inside_functions=True):
        """Files that are reached from a file, with the `__init__` files on the way, which Python runs too."""
        found, waiting = set(), [start]
        while waiting:
            path = waiting.pop()
            if path in found:
                continue
            found.add(path)
            waiting += self.imported(path, inside_functions)
            if self.source in path.parents:
                parts = self.name(path).split(".")
                waiting += [self.modules[".".join(parts[:n])] for n in range(1, len(parts))]
        return {path for path in found if self.source in path.parents}

    def circles(self):
        """Groups of files that import each other, by what they import outside of functions and inside."""
        graph = {path: set(self.imported(path)) - {path} for path in self.files}
        # a package's own __init__ collects names of its files, which is no circle by itself
        graph = {path: targets for path, targets in graph.items() if path.name != "__init__.py"}
        reach = {path: self._all(graph, path) for path in graph}
        groups = {frozenset(b for b in reach[a] if a in reach.get(b, ())) for a in graph if a in reach[a]}
        return [sorted(str(path.relative_to(self.root)) for path in group) for group in groups]

    @staticmethod
    def _all(graph, start):
        found, waiting = set(), list(graph.get(start, ()))
        while waiting:
            path = waiting.pop()
            if path not in found:
                found.add(path)
                waiting += graph.get(path, ())
        return found

    def long_functions(self):
        """Functions whose body, without docstring, has more than `LONGEST_BODY` lines."""
        found = []
        for path in self.files:
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                    body = node.body[1:] if ast.get_docstring(node) else node.body
                    length = node.end_lineno - body[0].lineno + 1 if body else 0
                    if length > LONGEST_BODY:
                        found.append(f"{path.relative_to(self.root)}:{node.name} ({length})")
        return found

    def figures(self):
        root, package = self.root, self.modules[PACKAGE]
        tests = [path for path in (root / "tests").rglob("*.py")]
        script = root / "examples" / "train_lctg.py"
        return {
            "lines under src": sum(map(lines, self.files)),
            "files under src": len(self.files),
            "lines of tests": sum(map(lines, tests)),
            "lines reached by `import tactile_diffusers`": sum(
                map(lines, self.reached(package, inside_functions=False))
            ),
            "lines reached by train_lctg.py": sum(map(lines, self.reached(script))) + lines(script),
            "functions with a body of more than 60 lines": self.long_functions(),
            "files of more than 400 lines": [str(p.relative_to(root)) for p in self.files if lines(p) > LONGEST_FILE],
            "circles of imports": self.circles(),
            "lines of README.md": lines(root / "README.md"),
        }


def _outside_functions(tree):
    waiting = list(tree.body)
    while waiting:
        node = waiting.pop()
        yield node
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            waiting += ast.iter_child_nodes(node)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("repository", nargs="?", type=Path, default=Path(__file__).parents[2])
    print(json.dumps(House(parser.parse_args().repository.resolve()).figures(), indent=1))


if __name__ == "__main__":
    main()
