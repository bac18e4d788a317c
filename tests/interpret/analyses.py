"""Analyses of small policies: what was found once is known to every test."""

import functools

import jax

from hitmdp_jax.agents import DAC, MOPG
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.learning.normalization import initial_statistics
from hitmdp_jax.runs.policy import Policy
from tests.interpret.known_returns import Payment


def analysis_of(agent):
    params = jax.jit(lambda key: agent.init(key, 2, 1).params)(jax.random.key(0))
    policy = Policy(agent, params, initial_statistics(2))
    return OptionAnalysis(policy, Payment(), jax.random.key(1), 3)


@functools.cache
def analysis_of_embeddings(num_options=9):
    return analysis_of(MOPG(num_options=num_options, embedding_size=5, hidden_sizes=(8,)))


@functools.cache
def analysis_of_terminations():
    return analysis_of(DAC(num_options=3, hidden_sizes=(8,)))
