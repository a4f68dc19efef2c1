"""Hooks of accelerate and diffusers: offloading, device maps and narrow storage see `forward` alone."""


def has_hooks(model):
    """Whether a part of a model has a hook. Then only `forward` may be called, not `condition`."""
    return any("_hf_hook" in vars(part) or "_diffusers_hook" in vars(part) for part in model.modules())
