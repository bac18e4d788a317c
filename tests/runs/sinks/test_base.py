import numpy as np

from hitmdp_jax.runs.sinks import Sinks
from hitmdp_jax.runs.sinks.base import columns


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
