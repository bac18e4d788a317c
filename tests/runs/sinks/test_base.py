import numpy as np

from hitmdp_jax.runs.sinks import Sinks
from hitmdp_jax.runs.sinks.base import columns, curves


class Recorder:
    def __init__(self, name, fail_at=None):
        self.name, self.fail_at, self.seen, self.closed = name, fail_at, [], False

    def write(self, iteration, env_steps, metrics):
        if iteration == self.fail_at:
            raise OSError(28, "No space left on device")
        self.seen.append(iteration)

    def flush(self):
        pass

    def close(self):
        self.closed = True


def test_a_failing_sink_is_told_once_and_left_out(capsys):
    good, bad = Recorder("good"), Recorder("bad", fail_at=2)
    sinks = Sinks(bad, good)
    for i in (1, 2, 3):
        sinks.write(i, i, {})
    sinks.close()
    assert good.seen == [1, 2, 3]
    assert good.closed
    assert bad.seen == [1]
    errors = capsys.readouterr().err
    assert errors == "warning: bad takes no more metrics: [Errno 28] No space left on device\n"


def test_vectors_become_columns():
    found = dict(columns({"a": np.array([1.0, 2.0]), "b": np.array([[1.0, 2.0], [3.0, 4.0]])}))
    assert list(found) == ["a", "b_0", "b_1"]
    np.testing.assert_array_equal(found["b_1"], [2.0, 4.0])


def test_curves_have_groups_and_options_have_shares_and_durations():
    metrics = {
        "recent_return": np.array([1.0]),
        "option_steps": np.array([[30.0, 10.0, 0.0]]),
        "option_activations": np.array([[0.0, 10.0, 0.0]]),
        "action_kl": np.array([0.01]),
        "prior_kl": np.array([0.5]),
        "option_clip_fraction": np.array([0.1]),
        "steps_per_second": np.array([9.0]),
        "reward_forward": np.array([2.0]),
    }
    found = {name: x[0] for name, x in curves(metrics)}
    np.testing.assert_equal(
        found,
        {
            "options/share_0": 0.75,
            "options/share_1": 0.25,
            "options/share_2": 0.0,
            "options/duration_0": 30.0,  # it went on throughout
            "options/duration_1": 1.0,
            "options/duration_2": np.nan,
            "return/recent_return": 1.0,
            "train/approx_kl_action": 0.01,
            "train/prior_kl": 0.5,
            "train/clip_fraction_option": 0.1,
            "time/steps_per_second": 9.0,
            "task/reward_forward": 2.0,
        },
    )
