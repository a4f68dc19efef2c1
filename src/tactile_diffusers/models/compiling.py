"""torch.compile of models whose blocks have many shapes."""

import inspect

import torch

#: graphs that torch.compile may keep for one function: fifteen blocks of different widths, a few batch sizes of each
MOST_GRAPHS = 64


def _with_room(kwargs):
    if "recompile_limit" in inspect.signature(torch.compile).parameters:
        return {"recompile_limit": MOST_GRAPHS, **kwargs}
    torch._dynamo.config.recompile_limit = max(torch._dynamo.config.recompile_limit, MOST_GRAPHS)
    return kwargs


class CompileMixin:
    """`compile` and `compile_repeated_blocks` with room for more graphs than torch's eight."""

    def compile(self, *args, **kwargs):
        """Compiles `forward`, see [`torch.nn.Module.compile`]; up to 64 graphs are kept."""
        return super().compile(*args, **_with_room(kwargs))

    def compile_repeated_blocks(self, *args, **kwargs):
        """Compiles each block of the U-Net, see [`ModelMixin.compile_repeated_blocks`]; up to 64 graphs are kept."""
        return super().compile_repeated_blocks(*args, **_with_room(kwargs))
