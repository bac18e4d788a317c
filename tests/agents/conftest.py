import pytest

from tests.agents.option_batches import random_params


@pytest.fixture
def params(agent):
    """Parameters of the test file's own `agent`."""
    return random_params(agent)
