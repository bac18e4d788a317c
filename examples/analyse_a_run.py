"""Train a small MOPG on HalfCheetah, then ask what its options are and what they are for.

python examples/analyse_a_run.py [FOLDER]
"""

import sys
from pathlib import Path

import jax

import hitmdp_jax
from hitmdp_jax.agents import MOPG
from hitmdp_jax.experiments import tables
from hitmdp_jax.figures import registry
from hitmdp_jax.interpret import interventions
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.interpret.perturbation import sentences


def main(folder, num_steps=40_960, episodes=4):
    """Train, analyse and draw into a folder."""
    env, agent = hitmdp_jax.make_env("halfcheetah", physics="native"), MOPG()
    key_train, key_record = jax.random.split(jax.random.key(0))
    train = jax.jit(lambda key: hitmdp_jax.train(agent, env, key, num_steps=num_steps)[0])
    state = train(key_train)
    policy = hitmdp_jax.Policy(agent.bind(state.spec), state.learner.params, state.normalizer)

    analysis = OptionAnalysis(policy, env, key_record, episodes)  # computes what is read
    print("share of the steps:", analysis.usage.round(2))
    print("divergence in nats:", analysis.divergence.round(3), sep="\n")
    tables.show(interventions.table(analysis.interventions))
    option, found = analysis.by_usage[0], analysis.perturbation
    assert found is not None  # MOPG's options are embeddings
    for sentence in sentences(found, option, analysis.spec.action.names):
        print(f"option {option}: {sentence}")

    folder.mkdir(parents=True, exist_ok=True)
    for name in ("figure5", "figure7", "causal"):
        registry.find(name).draw(analysis).savefig(folder / f"{name}.png", dpi=150)
        print(folder / f"{name}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "runs/analyse_a_run"))
