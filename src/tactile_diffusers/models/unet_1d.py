"""The one backbone: a 1-D U-Net that predicts the diffusion velocity, for LCTG and for DALE (paper section 2.2).

Everything in it is local in time (convolutions, norms over channels only), so a sample may have any length.
"""

import math
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import nn

from .attention import CrossAttention1D

#: up to this number of positions a convolution is computed as a matrix product over patches
FEW_POSITIONS = 8
#: from this number of rows on its channels are last in memory, on CPUs
MANY_ROWS = 8
#: each level halves the length: no texture is longer than 2^32 samples
MOST_LEVELS = 32


class ChannelRMSNorm(nn.Module):
    """Divides each time step by the root mean square of its channels: (batch, channels, length), same shape.

    It has no weights: a gain per channel is what the modulation or the next convolution already provides.
    """

    def forward(self, hidden_states):
        wide = hidden_states.float()
        power = (wide * wide).mean(dim=1, keepdim=True)  # product and mean: the fastest form on CPUs
        return hidden_states * power.add_(1e-6).rsqrt_().to(hidden_states.dtype)


class Conv1d(nn.Conv1d):
    """`nn.Conv1d`, computed as one matrix product where it has few positions, and channels last in a batch.

    On CPUs, PyTorch multiplies the weights by a matrix with a column for each position; with eight columns or fewer a
    product with the two exchanged is about three times as fast. A batch of eight or more is a tenth faster with its
    channels last in memory, which PyTorch does for two-dimensional convolutions alone; blocks between keep that order.
    """

    def forward(self, hidden_states):
        (size,), (stride,), (padding,) = self.kernel_size, self.stride, self.padding
        if torch.compiler.is_compiling():  # a compiled or exported graph has one form for all lengths and batches
            return super().forward(hidden_states)
        if hidden_states.shape[-1] + 2 * padding - size >= FEW_POSITIONS * stride:
            if len(hidden_states) < MANY_ROWS or hidden_states.device.type != "cpu":
                return super().forward(hidden_states)
            last = hidden_states[:, :, None].contiguous(memory_format=torch.channels_last)
            return F.conv2d(last, self.weight[:, :, None], self.bias, (1, stride), (0, padding)).squeeze(2)
        patches = F.pad(hidden_states, (padding, padding)).unfold(2, size, stride).transpose(1, 2).flatten(2)
        return F.linear(patches, self.weight.flatten(1), self.bias).transpose(1, 2)


class Stretch1D(nn.Module):
    """Multiplies the length by `ratio`, each position becoming `ratio` learned ones (a pointwise layer, reshuffled)."""

    def __init__(self, in_channels, out_channels, ratio):
        super().__init__()
        self.ratio = ratio
        self.conv = Conv1d(in_channels, out_channels * ratio, 1)

    def forward(self, hidden_states):
        return from_patches(self.conv(hidden_states), self.ratio)


def to_patches(hidden_states, size):
    """(batch, channels, length) -> (batch, channels * size, length / size)."""
    return hidden_states.unflatten(-1, (-1, size)).transpose(2, 3).flatten(1, 2)


def from_patches(hidden_states, size):
    """Undoes `to_patches`."""
    return hidden_states.unflatten(1, (-1, size)).transpose(2, 3).flatten(2, 3)


def _context_projection(context_channels, channels, ratio):
    """A learned resampling of context frames to a level that has `ratio` positions per frame (a power of two)."""
    if ratio >= 1:
        return Stretch1D(context_channels, channels, int(ratio))
    stride = round(1 / ratio)
    return Conv1d(context_channels, channels, stride, stride=stride)


class BlockConditions(NamedTuple):
    """What a block adds that does not depend on the sample: a sampler needs it once a call, not at each step.

    Attributes:
        gain, shift (`torch.Tensor`): (batch or 1, channels, 1), modulation after the second norm.
        context (`torch.Tensor` or `None`): (batch, channels, length), projected.
        tokens (`torch.Tensor` or `None`): (batch, tokens, cross_attention_dim).
    """

    gain: torch.Tensor
    shift: torch.Tensor
    context: torch.Tensor | None
    tokens: torch.Tensor | None


class ResnetBlock1D(nn.Module):
    """Residual block: two convolutions, modulated by the embedding, with the context added between them.

    Args:
        channels (`int`): channels.
        embedding_dim (`int`): width of the time (and condition) embedding: scale and shift after the second norm.
        kernel_size (`int`): odd length of both convolutions.
        context_channels (`int`, *optional*): channels of the context (LCTG: its latents), `None` = no context.
        context_ratio (`float`): positions of this level per context frame.
        cross_attention_dim (`int`, *optional*): width of condition tokens (DALE: the ratings), `None` = no attention.
    """

    def __init__(
        self,
        channels,
        embedding_dim,
        kernel_size,
        context_channels=None,
        context_ratio=1,
        cross_attention_dim=None,
    ):
        super().__init__()
        padding = kernel_size // 2
        self.act = nn.SiLU()
        self.norm1 = ChannelRMSNorm()
        self.conv1 = Conv1d(channels, channels, kernel_size, padding=padding)
        self.time_proj = nn.Linear(embedding_dim, 2 * channels)
        self.norm2 = ChannelRMSNorm()
        self.conv2 = Conv1d(channels, channels, kernel_size, padding=padding)
        nn.init.zeros_(self.conv2.weight)  # a new block is the identity
        nn.init.zeros_(self.conv2.bias)
        self.context_proj = self.attn = None
        if context_channels is not None:
            self.context_proj = _context_projection(context_channels, channels, context_ratio)
        if cross_attention_dim is not None:
            self.attn_norm = ChannelRMSNorm()
            self.attn = CrossAttention1D(channels, cross_attention_dim)
            self.context_scale = nn.Parameter(torch.ones(1))  # paper: "learnable context scaling"

    def condition(self, embedding, context=None, tokens=None):
        """The block's `BlockConditions`; the embedding may have a leading axis for steps."""
        scale, shift = self.time_proj(embedding)[..., None].chunk(2, dim=-2)
        context = None if self.context_proj is None else self.context_proj(context)
        return BlockConditions(1 + scale, shift, context, tokens)

    def forward(self, hidden_states, embedding=None, context=None, tokens=None, conditions=None):
        """(batch, channels, length), same shape out; `conditions` stand for the three before them."""
        if conditions is None:
            conditions = self.condition(embedding, context, tokens)
        residual = hidden_states
        hidden_states = self.conv1(self.act(self.norm1(hidden_states)))
        hidden_states = torch.addcmul(conditions.shift, self.norm2(hidden_states), conditions.gain)
        if conditions.context is not None:
            hidden_states = hidden_states + conditions.context
        hidden_states = residual + self.conv2(self.act(hidden_states))
        if self.attn is not None:
            queries = self.attn_norm(hidden_states).transpose(1, 2)
            attended = self.attn(queries, conditions.tokens)
            hidden_states = hidden_states + self.context_scale * attended.transpose(1, 2)
        return hidden_states


class UNet1D(nn.Module):
    """Velocity network on (batch, channels, length), composed by `LCTGModel` and `DALEModel`.

        sample ─ patches ─ conv_in ─ down[0] ─┬─ halve ─ … ─ mid ─ … ─ double ─(+)─ up[n-1] ─ conv_out ─ velocity
                                              └──────────── skip ───────────────┘

    Args:
        in_channels, out_channels (`int`): channels of the sample and of the velocity.
        widths (`list[int]`): channels of each level; each level halves the length, so there are `len(widths)`
            down-sampling and as many up-sampling layers.
        patch_size (`int`): consecutive time steps that the first layer takes as channels.
        embedding_dim (`int`): width of the embedding that modulates every block.
        kernel_size (`int`): odd length of the convolutions.
        context_channels (`int`, *optional*): channels of the frame-wise context injected at every level.
        context_stride (`int`, defaults to 1): time steps of the sample per context frame.
        cross_attention_dim (`int`, *optional*): width of the tokens attended to at every level.

    Raises:
        ValueError: if a size cannot be built: even kernel, or strides that do not divide each other.
    """

    def __init__(
        self,
        in_channels,
        out_channels,
        widths,
        patch_size,
        embedding_dim,
        kernel_size,
        context_channels=None,
        context_stride=1,
        cross_attention_dim=None,
    ):
        super().__init__()
        if not widths or min(widths) < 1:
            raise ValueError(f"`widths` must hold at least one positive number of channels, got {list(widths)}.")
        if len(widths) > MOST_LEVELS:
            raise ValueError(f"`widths` must hold at most {MOST_LEVELS} levels, got {len(widths)}.")
        if kernel_size % 2 == 0:
            raise ValueError(f"`kernel_size` must be odd, got {kernel_size}.")
        strides = [patch_size * 2**i for i in range(len(widths) + 1)]  # time steps per position, level by level
        if context_channels is not None:
            for stride in strides:
                if stride % context_stride and context_stride % stride:
                    raise ValueError(
                        f"Time steps per position of a level ({stride}, from `patch_size`={patch_size} and "
                        f"{len(widths)} `widths`) and per latent frame ({context_stride}) must divide each other."
                    )
        self.patch_size, self.context_stride = patch_size, context_stride
        #: lengths are padded to a multiple of this number of time steps
        self.stride = math.lcm(strides[-1], context_stride) if context_channels is not None else strides[-1]

        def block(channels, level):
            ratio = context_stride / strides[level]
            return ResnetBlock1D(channels, embedding_dim, kernel_size, context_channels, ratio, cross_attention_dim)

        self.conv_in = Conv1d(in_channels * patch_size, widths[0], 3, padding=1)
        self.down_blocks, self.downsamplers = nn.ModuleList(), nn.ModuleList()
        self.up_blocks, self.upsamplers = nn.ModuleList(), nn.ModuleList()
        next_widths = [*widths[1:], widths[-1]]
        for level, (width, wider) in enumerate(zip(widths, next_widths, strict=True)):
            self.down_blocks.append(block(width, level))
            self.downsamplers.append(Conv1d(width, wider, 2, stride=2))
        self.mid_block = block(widths[-1], len(widths))
        for level in reversed(range(len(widths))):
            self.upsamplers.append(Stretch1D(next_widths[level], widths[level], 2))
            self.up_blocks.append(block(widths[level], level))
        self.norm_out = ChannelRMSNorm()
        self.act = nn.SiLU()
        self.conv_out = Conv1d(widths[0], out_channels * patch_size, 3, padding=1)
        nn.init.zeros_(self.conv_out.weight)  # v = 0 at the start: the loss begins at the data's variance
        nn.init.zeros_(self.conv_out.bias)

    def _pad_context(self, context):
        per_stride = self.stride // self.context_stride
        return F.pad(context, (0, -context.shape[-1] % per_stride))

    def condition(self, embeddings, context=None, tokens=None):
        """The `BlockConditions` of all blocks, in the order in which they run, at each step of a sampler.

        Args:
            embeddings (`torch.Tensor`): (steps, batch or 1, embedding_dim).
            context, tokens: as for `forward`.

        Returns:
            `list[list[BlockConditions]]`: for each step, of each block.
        """
        blocks = (*self.down_blocks, self.mid_block, *self.up_blocks)
        context = None if context is None else self._pad_context(context)
        shared = [block.condition(embeddings, context, tokens) for block in blocks]
        steps = range(len(embeddings))
        return [[one._replace(gain=one.gain[step], shift=one.shift[step]) for one in shared] for step in steps]

    def forward(self, sample, embedding=None, context=None, tokens=None, checkpoint=None, conditions=None):
        """Velocity of a noisy sample.

        Args:
            sample (`torch.Tensor`): (batch, in_channels, length), any length >= 1.
            embedding (`torch.Tensor`): (batch, embedding_dim).
            context (`torch.Tensor`, *optional*): (batch, context_channels, ceil(length / context_stride)).
            tokens (`torch.Tensor`, *optional*): (batch, tokens, cross_attention_dim).
            checkpoint (`Callable`, *optional*): runs a block with gradient checkpointing.
            conditions (`list[BlockConditions]`, *optional*): of one step (`condition`), in place of the embedding,
                the context and the tokens.

        Returns:
            `torch.Tensor`: (batch, out_channels, length).
        """
        run = checkpoint if checkpoint is not None else lambda module, *args: module(*args)
        length = sample.shape[-1]
        padded = -(-length // self.stride) * self.stride
        sample = F.pad(sample, (0, padded - length))
        of_block = iter([None] * (2 * len(self.down_blocks) + 1) if conditions is None else conditions)
        context = None if context is None else self._pad_context(context)

        hidden_states = self.conv_in(to_patches(sample, self.patch_size))
        skips = []
        for block, downsampler in zip(self.down_blocks, self.downsamplers, strict=True):
            hidden_states = run(block, hidden_states, embedding, context, tokens, next(of_block))
            skips.append(hidden_states)
            hidden_states = downsampler(hidden_states)
        hidden_states = run(self.mid_block, hidden_states, embedding, context, tokens, next(of_block))
        for block, upsampler in zip(self.up_blocks, self.upsamplers, strict=True):
            hidden_states = upsampler(hidden_states) + skips.pop()  # added: half the cost of concatenating
            hidden_states = run(block, hidden_states, embedding, context, tokens, next(of_block))
        velocity = self.conv_out(self.act(self.norm_out(hidden_states)))
        return from_patches(velocity, self.patch_size)[..., :length]
