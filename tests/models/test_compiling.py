"""torch.compile with dynamic shapes: few graphs serve all batches and durations."""

import pytest
import torch
from torch._dynamo.utils import counters

#: One row or more, the shortest length or longer, padded or not: torch keeps a graph of each of these, not of each
#: length and batch.
MOST = 8


@pytest.fixture(autouse=True)
def fresh():
    torch._dynamo.reset()
    counters.clear()
    yield
    torch._dynamo.reset()


@torch.no_grad()
@pytest.mark.slow
def test_graphs_do_not_grow_with_batches_and_durations(make_pipeline):
    settings = {"scalar_width": 16, "distilled_steps": 1}
    pipe, plain = (make_pipeline(dale_config=settings, lctg_config={"distilled_steps": 1}) for _ in range(2))
    for model in (pipe.dale, pipe.lctg):
        model.compile(backend="eager", dynamic=True)  # the capture is what specialises
    graphs = []
    for batch, seconds in (
        (1, 0.1),
        (2, 0.3),
        (1, 0.9),
        (3, 0.55),
        (2, 0.11),
        (4, 1.3),
        (5, 0.77),
        (7, 0.42),
        (1, 0.64),
    ):
        ratings = [[0.5, 0.0, -0.5]] * batch
        found, expected = (
            one(ratings, duration_s=seconds, generator=torch.Generator().manual_seed(0)).textures
            for one in (pipe, plain)
        )
        torch.testing.assert_close(found, expected, rtol=0, atol=1e-5 * float(expected.std()) + 1e-9)
        graphs.append(counters["stats"]["unique_graphs"])
    assert graphs[-1] <= 2 * MOST and graphs[-1] == graphs[-3], graphs
