import numpy as np
import pytest

from tests.agents.compiled import Compiled
from tests.agents.option_batches import B, T, flatten, normal, random_batch, random_params


@pytest.fixture
def agent(request):
    """The `AGENT` of the test file, its methods compiled."""
    return Compiled(request.module.AGENT)


@pytest.fixture
def params(agent):
    """Parameters of the test file's own `agent`."""
    return random_params(agent)


@pytest.fixture
def data(agent, params):
    """A rollout as losses read it, with made-up advantages and exact values."""
    batch = random_batch()
    data, _ = agent.targets(params, batch)
    values, advantage = agent.values(params, batch), normal(np.random.default_rng(1), 2, T, B)
    return flatten(
        data
        | {"advantage_option": advantage[0], "value_target": values.value}
        | {"advantage_action": advantage[1], "q_target": values.q}
    )
