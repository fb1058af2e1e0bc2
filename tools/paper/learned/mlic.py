"""MLIC++ (Jiang et al., "MLIC++: Linear Complexity Multi-Reference Entropy Modeling for Learned Image Compression",
2023), written from the paper on CompressAI's layers.

The latents are coded slice by slice (channels), and each slice in two passes: first its anchors (one colour of a
checkerboard), then the others. What the probability of an element is predicted from:

- the hyperprior;
- channel context: the slices before;
- global inter-slice context: linear attention over the slices before;
- local context, for non-anchors: attention over the anchors of an overlapping 5 × 5 window;
- global intra-slice context, for non-anchors: linear attention that spreads the anchors of this slice. Its similarities
  come from the slice before, which both sides have.

Each pass ends with a latent residual prediction. Encoder and decoder run one function (`_passes`), so that both see the
same numbers.

Smaller than the authors' (N = 192, M = 320, 10 slices of 32): see `DEFAULTS`.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
import torch.nn as nn
import torch.nn.functional as F
from compressai.ans import BufferedRansEncoder, RansDecoder
from compressai.entropy_models import EntropyBottleneck, GaussianConditional
from compressai.layers import ResidualBlock, ResidualBlockUpsample, ResidualBlockWithStride, conv3x3, subpel_conv3x3
from compressai.models import CompressionModel
from compressai.ops import quantize_ste

METHOD = "mlic++"
DEFAULTS = {"n": 96, "m": 160, "slices": 5}
WINDOW = 5


def checkerboard(like: torch.Tensor, anchors: bool) -> torch.Tensor:
    """1 × 1 × height × width: 1 on the anchors (row + column is odd), or on the others."""
    height, width = like.shape[-2:]
    rows = torch.arange(height, device=like.device).view(-1, 1)
    columns = torch.arange(width, device=like.device).view(1, -1)
    odd = ((rows + columns) % 2 == 1).to(like.dtype)
    return (odd if anchors else 1 - odd).view(1, 1, height, width)


class ChannelContext(nn.Sequential):
    """Predicts from all slices before."""

    def __init__(self, before: int, out: int) -> None:
        super().__init__(nn.Conv2d(before, 96, 3, padding=1), nn.GELU(), nn.Conv2d(96, out, 3, padding=1))


class LocalContext(nn.Module):
    """Checkerboard attention: each element looks at the anchors of the 5 × 5 window around it."""

    def __init__(self, channels: int, out: int, heads: int = 2) -> None:
        super().__init__()
        self.heads = heads
        self.project = nn.Conv2d(channels, 3 * channels, 1)
        self.position = nn.Parameter(torch.zeros(heads, WINDOW * WINDOW))
        self.mix = nn.Conv2d(channels, channels, 1)
        self.feed = nn.Sequential(nn.Conv2d(channels, out, 1), nn.GELU(), nn.Conv2d(out, out, 1))

    def forward(self, anchors: torch.Tensor) -> torch.Tensor:
        batch, channels, height, width = anchors.shape
        query, key, value = self.project(anchors).chunk(3, 1)
        shape = (batch, self.heads, channels // self.heads, WINDOW * WINDOW, height * width)
        key = F.unfold(key, WINDOW, padding=WINDOW // 2).view(shape)
        value = F.unfold(value, WINDOW, padding=WINDOW // 2).view(shape)
        query = query.view(batch, self.heads, channels // self.heads, 1, height * width)
        weight = (query * key).sum(2) * (channels // self.heads) ** -0.5 + self.position.view(1, self.heads, -1, 1)
        known = F.unfold(checkerboard(anchors, True), WINDOW, padding=WINDOW // 2).view(1, 1, WINDOW * WINDOW, -1)
        weight = torch.softmax(weight.masked_fill(known == 0, -1e4), 2)
        context = (weight.unsqueeze(2) * value).sum(3).view(batch, channels, height, width)
        return self.feed(anchors + self.mix(context))


def _linear_attention(query: torch.Tensor, key: torch.Tensor, value: torch.Tensor, heads: int) -> torch.Tensor:
    """softmax(Q) (softmax(K)ᵀ V): linear in the number of elements."""
    batch, channels, height, width = value.shape
    query = torch.softmax(query.reshape(batch, heads, -1, query.shape[2] * query.shape[3]), 2)
    key = torch.softmax(key.reshape(batch, heads, -1, key.shape[2] * key.shape[3]), 3)
    value = value.reshape(batch, heads, channels // heads, -1)
    context = key @ value.transpose(2, 3)
    return (context.transpose(2, 3) @ query).view(batch, channels, height, width)


def _pointwise_and_depthwise(inputs: int, out: int) -> nn.Sequential:
    return nn.Sequential(nn.Conv2d(inputs, out, 1), nn.Conv2d(out, out, 3, padding=1, groups=out))


class GlobalInterContext(nn.Module):
    """Linear attention over all slices before."""

    def __init__(self, before: int, out: int, heads: int = 4) -> None:
        super().__init__()
        self.heads = heads
        self.query = _pointwise_and_depthwise(before, out)
        self.key = _pointwise_and_depthwise(before, out)
        self.value = _pointwise_and_depthwise(before, out)
        self.mix = nn.Conv2d(out, out, 1)
        self.feed = nn.Sequential(nn.Conv2d(out, out, 1), nn.GELU(), nn.Conv2d(out, out, 1))

    def forward(self, before: torch.Tensor) -> torch.Tensor:
        value = self.value(before)
        context = self.mix(_linear_attention(self.query(before), self.key(before), value, self.heads))
        return self.feed(context + value)


class GlobalIntraContext(nn.Module):
    """Spreads this slice's anchors over the picture, by the likeness of places in the slice before."""

    def __init__(self, channels: int, out: int, heads: int = 4) -> None:
        super().__init__()
        self.heads = heads
        self.query = _pointwise_and_depthwise(channels, channels)
        self.key = _pointwise_and_depthwise(channels, channels)
        self.value = _pointwise_and_depthwise(channels, channels)
        self.feed = nn.Sequential(nn.Conv2d(channels, out, 1), nn.GELU(), nn.Conv2d(out, out, 1))

    def forward(self, before: torch.Tensor, anchors: torch.Tensor) -> torch.Tensor:
        query = self.query(before * checkerboard(before, False))
        key = self.key(before * checkerboard(before, True))
        return self.feed(_linear_attention(query, key, self.value(anchors), self.heads))


def _pointwise(inputs: int, hidden: int, out: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, hidden, 1), nn.GELU(), nn.Conv2d(hidden, hidden, 1), nn.GELU(), nn.Conv2d(hidden, out, 1)
    )


class Slice(nn.Module):
    """The networks of one slice. `before` is the number of channels of the slices before."""

    def __init__(self, channels: int, before: int, hyper: int) -> None:
        super().__init__()
        wide = 2 * channels
        self.first = before == 0
        if not self.first:
            self.channel = ChannelContext(before, wide)
            self.inter = GlobalInterContext(before, wide)
            self.intra = GlobalIntraContext(channels, wide)
        self.local = LocalContext(channels, wide)
        known = hyper + (0 if self.first else 2 * wide)
        self.anchor_parameters = _pointwise(known, 128, 2 * channels)
        self.other_parameters = _pointwise(known + wide + (0 if self.first else wide), 160, 2 * channels)
        self.anchor_residual = _pointwise(hyper + before + channels, 96, channels)
        self.other_residual = _pointwise(hyper + before + channels, 96, channels)


# Takes a slice's elements of one pass: (slice number, means, scales, mask) → the quantised elements, 0 elsewhere.
Coder = Callable[[int, torch.Tensor, torch.Tensor, torch.Tensor], torch.Tensor]


class MlicPlusPlus(CompressionModel):
    def __init__(self, n: int, m: int, slices: int) -> None:
        super().__init__()
        if m % slices or (m // slices) % 4:
            raise ValueError(f"{m} channels do not make {slices} slices of a multiple of 4 channels")
        self.channels, self.slice_count = m // slices, slices
        self.g_a = nn.Sequential(
            ResidualBlockWithStride(3, n, stride=2),
            ResidualBlock(n, n),
            ResidualBlockWithStride(n, n, stride=2),
            ResidualBlock(n, n),
            ResidualBlockWithStride(n, n, stride=2),
            ResidualBlock(n, n),
            conv3x3(n, m, stride=2),
        )
        self.g_s = nn.Sequential(
            ResidualBlock(m, n),
            ResidualBlockUpsample(n, n, 2),
            ResidualBlock(n, n),
            ResidualBlockUpsample(n, n, 2),
            ResidualBlock(n, n),
            ResidualBlockUpsample(n, n, 2),
            ResidualBlock(n, n),
            subpel_conv3x3(n, 3, 2),
        )
        self.h_a = nn.Sequential(
            conv3x3(m, n),
            nn.GELU(),
            conv3x3(n, n),
            nn.GELU(),
            conv3x3(n, n, stride=2),
            nn.GELU(),
            conv3x3(n, n),
            nn.GELU(),
            conv3x3(n, n, stride=2),
        )
        self.h_s = nn.Sequential(
            conv3x3(n, n),
            nn.GELU(),
            subpel_conv3x3(n, n, 2),
            nn.GELU(),
            conv3x3(n, n),
            nn.GELU(),
            subpel_conv3x3(n, n, 2),
            nn.GELU(),
            conv3x3(n, 2 * n),
        )
        self.slices = nn.ModuleList(Slice(self.channels, i * self.channels, 2 * n) for i in range(slices))
        self.entropy_bottleneck = EntropyBottleneck(n)
        self.gaussian_conditional = GaussianConditional(None)

    def training_pass(self, x: torch.Tensor, half: bool) -> tuple[torch.Tensor, torch.Tensor]:
        """The decoded batch, and the bits that it takes. Rates see noise, the decoder sees rounded values."""
        with torch.autocast("cpu", torch.bfloat16, enabled=half):
            y = self.g_a(x)
            z = self.h_a(y)
        y, z = y.float(), z.float()
        _, z_likelihoods = self.entropy_bottleneck(z)
        medians = self.entropy_bottleneck._get_medians().view(1, -1, 1, 1)
        z_hat = quantize_ste(z - medians) + medians
        bits = [-torch.log2(z_likelihoods).sum()]
        slices = y.chunk(self.slice_count, 1)

        def coder(index: int, means: torch.Tensor, scales: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
            _, likelihoods = self.gaussian_conditional(slices[index], scales, means=means)
            bits.append(-(torch.log2(likelihoods) * mask).sum())
            return (quantize_ste(slices[index] - means) + means) * mask

        with torch.autocast("cpu", torch.bfloat16, enabled=half):
            hyper = self.h_s(z_hat)
        y_hat = self._passes(hyper.float(), coder)
        with torch.autocast("cpu", torch.bfloat16, enabled=half):
            x_hat = self.g_s(y_hat)
        return x_hat.float(), torch.stack(bits).sum()

    def _passes(self, hyper: torch.Tensor, coder: Coder) -> torch.Tensor:
        """All slices, two passes each; the quantised latents."""
        anchor_mask, other_mask = checkerboard(hyper, True), checkerboard(hyper, False)
        done: list[torch.Tensor] = []
        for index, nets in enumerate(self.slices):
            known = [hyper]
            if not nets.first:
                before = torch.cat(done, 1)
                known += [nets.channel(before), nets.inter(before)]
            scales, means = nets.anchor_parameters(torch.cat(known, 1)).chunk(2, 1)
            anchors = coder(index, means, scales, anchor_mask)
            support = torch.cat([hyper, *done], 1)
            residual = nets.anchor_residual(torch.cat([support, anchors], 1))
            anchors = anchors + 0.5 * torch.tanh(residual) * anchor_mask

            known.append(nets.local(anchors))
            if not nets.first:
                known.append(nets.intra(done[-1], anchors))
            scales, means = nets.other_parameters(torch.cat(known, 1)).chunk(2, 1)
            others = coder(index, means, scales, other_mask)
            residual = nets.other_residual(torch.cat([support, anchors + others], 1))
            done.append(anchors + others + 0.5 * torch.tanh(residual) * other_mask)
        return torch.cat(done, 1)

    def latents(self, x: torch.Tensor) -> tuple[list[list[bytes]], torch.Size, torch.Tensor]:
        """Codes one padded picture: strings (latents, hyper-latents), the hyper-latents' shape, the latents."""
        y = self.g_a(x)
        z = self.h_a(y)
        z_strings = self.entropy_bottleneck.compress(z)
        z_hat = self.entropy_bottleneck.decompress(z_strings, z.shape[-2:])
        slices = y.chunk(self.slice_count, 1)
        symbols: list[int] = []
        indexes: list[int] = []

        def coder(index: int, means: torch.Tensor, scales: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
            levels = torch.round(slices[index] - means)
            chosen = mask.expand_as(levels) > 0
            symbols.extend(levels[chosen].int().tolist())
            indexes.extend(self.gaussian_conditional.build_indexes(scales)[chosen].tolist())
            return (levels.int().float() + means) * mask

        y_hat = self._passes(self.h_s(z_hat), coder)
        encoder = BufferedRansEncoder()
        encoder.encode_with_indexes(symbols, indexes, *self._tables())
        return [[encoder.flush()], z_strings], z.shape[-2:], y_hat

    def compress(self, x: torch.Tensor) -> dict:
        strings, shape, _ = self.latents(x)
        return {"strings": strings, "shape": shape}

    def decode_latents(self, strings: list[list[bytes]], shape: tuple[int, int]) -> torch.Tensor:
        """The latents, from the strings alone."""
        z_hat = self.entropy_bottleneck.decompress(strings[1], shape)
        decoder = RansDecoder()
        decoder.set_stream(strings[0][0])
        tables = self._tables()

        def coder(_: int, means: torch.Tensor, scales: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
            chosen = mask.expand_as(means) > 0
            indexes = self.gaussian_conditional.build_indexes(scales)[chosen].tolist()
            levels = torch.zeros_like(means)
            levels[chosen] = torch.tensor(decoder.decode_stream(indexes, *tables), dtype=means.dtype)
            return (levels + means) * mask

        return self._passes(self.h_s(z_hat), coder)

    def decompress(self, strings: list[list[bytes]], shape: tuple[int, int]) -> dict:
        return {"x_hat": self.g_s(self.decode_latents(strings, shape)).clamp(0, 1)}

    def _tables(self) -> tuple[list, list, list]:
        table = self.gaussian_conditional
        return table.quantized_cdf.tolist(), table.cdf_length.int().tolist(), table.offset.int().tolist()
