r"""Prediction bands: how sure a predicted effort is, and how far a measured one may lie from it.

The predicted effort of row $j$ is $y_j^T \hat\phi$ with the row's regressor entries $y_j$, behind
the score's low-pass as the effort is; what is left open of the parameters makes its standard
deviation $\sqrt{y_j^T C y_j}$: the band of the model. A new measurement scatters around that by its
residual too: $\sqrt{y_j^T C y_j + s_j^2}$.

The residuals behind an estimate have gone through the parallel filter, scores go through another
low-pass. White residuals have variances in the ratio of the filters' noise bandwidths, which $s_j$
follows where a score looks at more; where it looks at less, it is not credited with that, for what
a model lacks is slow.
"""

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.estimation.calibration import Calibration
from steelyard.estimation.estimate import Z95
from steelyard.estimation.external.uncertainty import covariance_root
from steelyard.estimation.identified import IdentifiedModel
from steelyard.measurement.methods.lowpass import noise_bandwidth as low_pass_bandwidth
from steelyard.measurement.run import Block
from steelyard.regression.regressor import Regressor, base_regressor
from steelyard.validation.model_std import ModelStd


@dataclass(frozen=True, eq=False)
class Bands:
    """What bands are made from.

    Attributes:
        regressor: Base columns of the model.
        factor: `F`, with `F @ F.T` the covariance of the base parameters, shape `(p, k)`.
        sigma: Standard deviation of the residuals per row behind the score's low-pass, in the
            unit of the joint's effort, shape `(n,)`; NaN of a joint without samples.
        calibration: Half-widths of 95 % bands; those of noise alone if `None`.
    """

    regressor: Regressor
    factor: Array
    sigma: Array
    calibration: Calibration | None = None

    @classmethod
    def of(cls, identified: IdentifiedModel) -> "Bands":
        """The bands of an identified model, for scores with its own cut-off."""
        cutoffs = identified.cutoffs
        return cls(
            base_regressor(identified.model),
            frozen(covariance_root(identified.base_covariance)),
            frozen(identified.residual_std(low_pass_bandwidth(cutoffs.score))),
            identified.calibration,
        )

    def half_width(self, block: Block, model_std: Array) -> Array:
        """Half-width of the band that holds 95 % of new measurements, in the effort's unit.

        A calibration below 1.96 says that residuals are smaller than their standard deviation; it
        does not make parameters surer, whose errors show in motions unlike those left out.

        Args:
            block: Samples.
            model_std: Standard deviation of their predicted efforts.

        Returns:
            Shape `(n, B)`; NaN of a joint whose `sigma` is.
        """
        noise = np.broadcast_to(self.sigma[:, None], model_std.shape)
        if self.calibration is None:
            return np.asarray(Z95 * np.hypot(model_std, noise))
        n = len(self.sigma)
        factor = self.calibration.factor(block.dq[:n], block.moving[:n])
        return np.asarray(np.hypot(np.maximum(factor, Z95) * model_std, factor * noise))

    def columns(self, block: Block) -> Array:
        """The regressor's outputs, which `std_behind` takes, shape `(C, B)`.

        Args:
            block: Samples with the model's channels.
        """
        channels = np.empty((0, len(block.t))) if block.channels is None else block.channels
        inputs = (block.q, block.dq, block.ddq, channels, np.zeros_like(block.q))
        return self.regressor.code([np.ascontiguousarray(x) for x in inputs])

    def std_behind(self, cutoff: float, rate: float) -> ModelStd:
        """What makes of `columns` the standard deviation of the low-passed predicted effort.

        Args:
            cutoff: Of the zero-phase low-pass [Hz].
            rate: Of the samples [Hz].
        """
        return ModelStd.behind(cutoff, rate, self.regressor.layout, self.factor)
