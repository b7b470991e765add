"""A feature extractor of stable-baselines3 for scans, which are sets: the order of detections is nothing.

Needs the extra `agents`.
"""

from typing import Any

from gymnasium import spaces

from gmr_gym.checks import check_choice, check_count
from gmr_gym.recorded.extras import module_of

torch = module_of("agents", "torch", "gmr_gym.learning.set_features")
module_of("agents", "stable_baselines3", "gmr_gym.learning.set_features")

from stable_baselines3.common.torch_layers import BaseFeaturesExtractor  # noqa: E402

POOLS = "mean", "maximum", "attention"


class SetFeatures(BaseFeaturesExtractor):
    r"""Features of a scan that do not depend on the order of its detections, or on what padding contains.

    Each detection goes through one network, and what comes out is pooled, feature by feature. All else in the
    observation is added as it is. Of an empty scan the pooled features are zero.

    Parameters
    ----------
    observation_space : gymnasium.spaces.Dict
        With detections (k, p) and their mask (k,).
    pool : {"mean", "maximum", "attention"}
        Over the detections. "attention" weighs them by the softmax of scores that the network gives.
    width : int
        Number of pooled features, and of hidden units.
    detections : str
        Key of the detections: "scan" in an environment that is not wrapped.

    Raises
    ------
    ValueError
        For a space without detections and mask, an unknown `pool`, or a `width` that is not a count.

    Notes
    -----
    With :math:`h_i` the features of detection i and :math:`s_i` its scores, attention pools

    .. math::

        \sum_i \frac{e^{s_i}}{\sum_j e^{s_j}} h_i

    References
    ----------
    Zaheer et al. 2017, "Deep sets"; Ilse, Tomczak and Welling 2018, "Attention-based deep multiple instance
    learning".
    """

    def __init__(
        self,
        observation_space: spaces.Dict,
        pool: str = "attention",
        width: int = 64,
        detections: str = "detections",
    ):
        check_choice("pool", pool, POOLS)
        width = check_count(width, "width")
        parts = getattr(observation_space, "spaces", {})
        if not {detections, "mask"} <= parts.keys():
            raise ValueError(
                f"observation_space must be a Dict with {detections!r} and 'mask', got {observation_space}"
            )
        self._others = [key for key in parts if key not in (detections, "mask")]
        rest = sum(spaces.flatdim(parts[key]) for key in self._others)
        super().__init__(observation_space, width + rest)
        self._key, self._pool = detections, pool
        p = parts[detections].shape[1]
        self.each = torch.nn.Sequential(
            torch.nn.Linear(p, width), torch.nn.ReLU(), torch.nn.Linear(width, width), torch.nn.ReLU()
        )
        if pool == "attention":
            self.score = torch.nn.Linear(width, width)

    def forward(self, observations: dict[str, Any]) -> Any:
        """Features (n, width and what else the observation has) of a batch of observations."""
        mask = observations["mask"].bool()[:, :, None]
        # where, as nothing times a padding of nan is nan
        h = self.each(torch.where(mask, observations[self._key], 0.0))
        others = [observations[key].flatten(1) for key in self._others]
        return torch.cat([self._pooled(h, mask), *others], dim=1)

    def _pooled(self, h: Any, mask: Any) -> Any:
        """Features (n, width) of sets of features h (n, k, width), of which those of the mask (n, k, 1)
        count."""
        if self._pool == "maximum":  # features are not negative
            return torch.where(mask, h, 0.0).amax(dim=1)
        if self._pool == "mean":
            w = mask / mask.sum(dim=1, keepdim=True).clamp(min=1)
        else:
            s = torch.where(mask, self.score(h), -torch.inf)
            s = s - s.amax(dim=1, keepdim=True).clamp(min=torch.finfo(s.dtype).min)  # of an empty scan -inf
            w = s.exp()
            w = w / w.sum(dim=1, keepdim=True).clamp(min=1.0)  # at least the largest, which is 1
        return (w * h).sum(dim=1)
