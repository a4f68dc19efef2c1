"""Cross-attention of a 1-D feature map to rating tokens, in diffusers' current form (processor and dispatcher)."""

from diffusers.models.attention import AttentionModuleMixin
from diffusers.models.attention_dispatch import dispatch_attention_fn
from torch import nn


class CrossAttnProcessor:
    """Computes :class:`CrossAttention1D` through diffusers' attention backends."""

    _attention_backend = None
    _parallel_config = None

    def __call__(self, attn, hidden_states, encoder_hidden_states):
        query = attn.to_q(hidden_states).unflatten(-1, (attn.heads, -1))  # (batch, positions, heads, head_dim)
        key, value = (to(encoder_hidden_states).unflatten(-1, (attn.heads, -1)) for to in (attn.to_k, attn.to_v))
        out = dispatch_attention_fn(
            query, key, value, backend=self._attention_backend, parallel_config=self._parallel_config
        )
        return attn.to_out[0](out.flatten(2, 3))


class CrossAttention1D(nn.Module, AttentionModuleMixin):
    """Positions of a feature map (queries) attend to condition tokens (keys and values).

    Args:
        dim (`int`): channels of the feature map.
        cross_attention_dim (`int`): width of the tokens.
        head_dim (`int`, defaults to 32): width of a head; `dim` must be a multiple of it.
    """

    _default_processor_cls = CrossAttnProcessor
    _available_processors = [CrossAttnProcessor]
    _supports_qkv_fusion = False  # three tokens: nothing to gain

    def __init__(self, dim, cross_attention_dim, head_dim=32):
        super().__init__()
        if dim % head_dim:
            raise ValueError(f"`widths` must be multiples of the attention head width {head_dim}, got {dim}.")
        self.heads = dim // head_dim
        self.is_cross_attention = True
        self.to_q = nn.Linear(dim, dim, bias=False)
        self.to_k = nn.Linear(cross_attention_dim, dim, bias=False)
        self.to_v = nn.Linear(cross_attention_dim, dim, bias=False)
        self.to_out = nn.ModuleList([nn.Linear(dim, dim)])
        self.set_processor(self._default_processor_cls())

    def forward(self, hidden_states, encoder_hidden_states):
        """(batch, positions, dim), (batch, tokens, cross_attention_dim) -> (batch, positions, dim)."""
        return self.processor(self, hidden_states, encoder_hidden_states)
