"""Mean & Scale Hyperprior (Minnen et al., 2018), CompressAI's.

The transforms may run in bfloat16 in training. The entropy models never do: a likelihood near 1 has no room there.
"""

from __future__ import annotations

import torch
from compressai.models import MeanScaleHyperprior

METHOD = "mean-scale-hyperprior"
DEFAULTS = {"n": 128, "m": 192}


class MeanScale(MeanScaleHyperprior):
    def __init__(self, n: int, m: int) -> None:
        super().__init__(n, m)

    def training_pass(self, x: torch.Tensor, half: bool) -> tuple[torch.Tensor, torch.Tensor]:
        """The decoded batch, and the bits that it takes."""
        with torch.autocast("cpu", torch.bfloat16, enabled=half):
            y = self.g_a(x)
            z = self.h_a(y)
        z_hat, z_likelihoods = self.entropy_bottleneck(z.float())
        with torch.autocast("cpu", torch.bfloat16, enabled=half):
            scales, means = self.h_s(z_hat).chunk(2, 1)
        y_hat, y_likelihoods = self.gaussian_conditional(y.float(), scales.float(), means=means.float())
        with torch.autocast("cpu", torch.bfloat16, enabled=half):
            x_hat = self.g_s(y_hat)
        bits = -(torch.log2(y_likelihoods).sum() + torch.log2(z_likelihoods).sum())
        return x_hat.float(), bits
