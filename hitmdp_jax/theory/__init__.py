"""The theory of HiT-MDPs, executable: SMDP options and HiT-MDPs over finite sets, exactly.

Each theorem of the paper is a function here, each module one question; docs/theory.md walks through
them, docs/errata.md lists what the paper prints differently. Everything may be jitted, vmapped and
differentiated, and runs in float64 where x64 is enabled, else in float32.
"""

from hitmdp_jax.theory.deep import deep_value, remembered
from hitmdp_jax.theory.evidence import (
    Evidence,
    elbo_objective,
    evidence,
    option_log_posterior,
)
from hitmdp_jax.theory.gradients import (
    PolicyGradient,
    action_policy_gradient,
    master_policy_gradient,
    policy_gradient,
)
from hitmdp_jax.theory.hit_mdp import (
    HiddenValues,
    HiTMDP,
    hidden_temporal_operator,
    hidden_values,
    hit_mdp,
    markovian_option_value,
    objective,
    occupancy,
)
from hitmdp_jax.theory.improvement import (
    greedy,
    improve,
    optimality_operator,
    policy_iteration,
)
from hitmdp_jax.theory.model import (
    OptionModel,
    check,
    initiable_master_policy,
    markovian_master_policy,
    mixture_master_policy,
    sample_option_model,
)
from hitmdp_jax.theory.prior import best_master, sticky_prior, with_prior
from hitmdp_jax.theory.smdp import MultiTimeModel, SMDPValues, evaluate_smdp, multi_time_model
from hitmdp_jax.theory.trajectories import (
    HiddenTrajectory,
    Trajectory,
    call_and_return_probability,
    discounted_return,
    enumerate_trajectories,
    first_option,
    hit_mdp_probability,
    one_hot,
    partition,
    smdp_probability,
)
from hitmdp_jax.theory.values import (
    Values,
    bellman_operator,
    distances_to_fixed_point,
    evaluate,
    evaluate_by_iteration,
    option_value_upon_arrival,
)
from hitmdp_jax.theory.variance import (
    VarianceDecomposition,
    expected_value,
    previous_option_belief,
    return_second_moment,
    variance_decomposition,
    visits,
)
