"""Overlapping windows of long textures: nothing is lost, nothing is weaker, and rows stay apart."""

import pytest
import torch

from tactile_diffusers.pipelines.velocities import Windows, in_chunks


def _normal(*shape, seed=0):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize(
    ("total", "size"), [(32, 32), (33, 32), (55, 32), (56, 32), (80, 32), (81, 32), (200, 32), (9, 4)]
)
def test_windows_cover_everything(total, size):
    windows = Windows(total, size)
    assert windows.starts[0] == 0 and windows.starts[-1] == total - size
    covered = torch.zeros(total)
    for start in windows.starts:
        covered[start : start + size] += 1
    assert covered.min() >= 1
    for start, following in zip(windows.starts[:-1], windows.starts[1:], strict=True):
        assert 0 < following - start <= size - windows.overlap  # neighbours overlap by at least a quarter
    weights = windows.weights("cpu")
    assert (weights >= 0).all()
    summed = torch.zeros(total)
    for weight, start in zip(weights, windows.starts, strict=True):
        summed[start : start + size] += weight
    torch.testing.assert_close(summed, torch.ones(total))


def test_fusing_keeps_the_variance_of_windows_that_disagree():
    windows = Windows(512, 128)
    pieces = _normal(len(windows.starts) * 400, 1, 128)
    power = windows.fuse(pieces).square().mean((0, 1))
    # 400 rows: the standard error of a power is 7 % a position; averaged over 16 positions below 4 % of the rest
    assert power.mean() == pytest.approx(1.0, abs=0.02)
    assert (power.unflatten(0, (32, 16)).mean(1) - 1).abs().max() < 0.1


def test_rows_do_not_depend_on_the_rest_of_the_batch():
    # a list of generators must equal single calls, so how well windows agree is measured row by row
    windows = Windows(80, 32)
    count = len(windows.starts)
    agreeing = windows.cut(_normal(1, 2, 80))
    disagreeing = _normal(count, 2, 32, seed=1)
    both = torch.stack([agreeing, disagreeing], dim=1).flatten(0, 1)  # window by window, as `split` orders them
    fused = windows.fuse(both)
    torch.testing.assert_close(fused[:1], windows.fuse(agreeing), rtol=0, atol=1e-5)
    torch.testing.assert_close(fused[1:], windows.fuse(disagreeing), rtol=0, atol=1e-5)


def test_chunks_equal_the_whole():
    sizes = []

    def double(x, y):
        sizes.append(len(x))
        return 2 * x + y

    x, y = _normal(70, 3), _normal(70, 3, seed=1)
    assert torch.equal(in_chunks(double, x, y), 2 * x + y)
    assert sizes == [32, 32, 6]
