"""Analyses of small policies: what was found once is known to every test."""

import functools

import jax

from hitmdp_jax.agents import DAC, MOPG
from hitmdp_jax.envs.spec import spec_of
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from tests.interpret.known_returns import Payment
from tests.probes import untrained_policy


def analysis_of(agent):
    bound = agent.bind(spec_of(Payment()))
    policy = jax.jit(lambda key: untrained_policy(bound, key))(jax.random.key(0))
    return OptionAnalysis(policy, Payment(), jax.random.key(1), 3)


@functools.cache
def analysis_of_embeddings(num_options=9):
    return analysis_of(MOPG(num_options=num_options, embedding_size=5, hidden_sizes=(8,)))


@functools.cache
def analysis_of_terminations():
    return analysis_of(DAC(num_options=3, hidden_sizes=(8,)))
