"""Hooks of accelerate and diffusers: offloading, device maps and narrow storage see `forward` alone."""


def has_hooks(model):
    """Whether a part of a model has a hook. Then only `forward` may be called, not `condition`."""
    parts = [model]  # `model.modules()` takes five times as long, and a call asks several times
    while parts:
        own = vars(parts.pop())
        if "_hf_hook" in own or "_diffusers_hook" in own:
            return True
        parts += [part for part in own["_modules"].values() if part is not None]
    return False


class HookMixin:
    """`dtype` without diffusers' search through all parts, twice, where no hook may have changed it."""

    @property
    def dtype(self):
        """dtype of the weights, or that in which a model of narrow storage computes."""
        return super().dtype if has_hooks(self) else next(self.parameters()).dtype
