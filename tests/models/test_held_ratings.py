"""Ratings beyond what training knew are held at its edge, in velocities and in whole calls."""

import numpy as np
import pytest
import torch

RANGE = [[-1.5, 1.2], [-1.0, 2.0], [-2.0, 1.8]]


@pytest.fixture
def dale(make_dale):
    return make_dale(rating_statistics={"range": RANGE})


@torch.no_grad()
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("end", [0, 1])
def test_a_rating_beyond_the_range_acts_as_its_end(dale, axis, end):
    sample = torch.randn(1, 6, 32, generator=torch.Generator().manual_seed(0))
    rows = torch.zeros(4, 3)
    rows[:, axis] = torch.tensor([RANGE[axis][end] * factor for factor in (0.5, 1.0, 1.5, 3.0)])
    inside, at_end, beyond, far = (dale(sample, 500, row[None]).sample for row in rows)
    assert torch.equal(at_end, beyond) and torch.equal(at_end, far) and not torch.allclose(inside, at_end, atol=1e-4)


@torch.no_grad()
def test_axes_that_are_not_specified_stay_so(dale):
    sample, nothing = torch.zeros(1, 6, 32), torch.full((1, 3), torch.nan)
    assert not torch.allclose(dale(sample, 500, nothing).sample, dale(sample, 500, torch.zeros(1, 3)).sample, atol=1e-4)


def test_a_call_beyond_the_range_gives_the_texture_of_its_end(make_pipeline):
    pipe = make_pipeline(dale_config={"rating_statistics": {"range": RANGE}})
    ends, beyond = (
        pipe(ratings, generator=torch.Generator().manual_seed(0), guidance_scale=2.0).textures
        for ratings in ([1.2, -1.0, 1.8], [6.0, -6.0, 6.0])
    )
    np.testing.assert_array_equal(ends, beyond)
