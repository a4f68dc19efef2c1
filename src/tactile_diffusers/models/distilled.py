"""What distilled models share: the number of solver steps that they learned."""


def check_distilled_steps(steps):
    """A ValueError unless `steps` is `None` or at least 1."""
    if steps is not None and not steps >= 1:
        raise ValueError(f"`distilled_steps` must be at least 1, or None, got {steps}.")
