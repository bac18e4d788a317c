"""Pure pieces that agents share: rollout, advantages, surrogate, optimisation, option counts."""
