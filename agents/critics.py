"""Policies of stable-baselines3 whose critic is told what the actor is not: see
`gmr_gym.tuning.hindsight`. An observation is features, which both see, and then HINDSIGHT."""

import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, MlpExtractor
from stable_baselines3.sac.policies import SACPolicy

from gmr_gym.tuning.hindsight import HINDSIGHT


class Seen(BaseFeaturesExtractor):
    """Of an observation (n, k), what an actor may see."""

    def __init__(self, observation_space):
        super().__init__(observation_space, observation_space.shape[0] - len(HINDSIGHT))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        return observations[:, : self.features_dim]


class OnPolicy(ActorCriticPolicy):
    """Of PPO."""

    def _build_mlp_extractor(self) -> None:
        super()._build_mlp_extractor()
        seen = Seen(self.observation_space)
        narrow = MlpExtractor(seen.features_dim, self.net_arch, self.activation_fn, self.device)
        self.mlp_extractor.policy_net = torch.nn.Sequential(seen, *narrow.policy_net)


class OffPolicy(SACPolicy):
    """Of SAC."""

    def make_actor(self, features_extractor=None):
        return super().make_actor(Seen(self.observation_space))
