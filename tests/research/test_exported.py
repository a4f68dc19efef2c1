"""Networks as exported programs: any batch and number of frames, the same velocity."""

import exported
import pytest


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dale", "lctg"])
def test_an_exported_network_gives_the_same_velocity_for_any_shape(make_pipeline, name):
    model = getattr(make_pipeline(), name)
    network = exported.exported(model).module()
    assert exported.largest_difference(model, network) < 1e-4  # float32, sums in another order
