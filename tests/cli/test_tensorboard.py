import types

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from hitmdp_jax.cli.tensorboard import OptionFigures
from hitmdp_jax.runs.checkpoint import Progress
from tests.figures.test_curves import write_run


def hook(folder):
    config = types.SimpleNamespace(checkpoint_steps=5, title="a run", switch_at=None)
    figures = OptionFigures(config, folder)  # type: ignore
    return lambda iteration: figures(Progress(iteration, 0, None), 10 * iteration)


def test_option_usage_and_durations_are_shown_as_the_run_goes_on(tmp_path):
    show = hook(tmp_path)
    for iteration in (5, 10):
        write_run(tmp_path, iteration)
        assert show(iteration) == {}
    events = EventAccumulator(str(tmp_path / "figures")).Reload()
    assert [picture.step for picture in events.Images("option_durations")] == [50, 100]


def test_a_policy_without_options_has_no_such_figure(tmp_path):
    write_run(tmp_path, options=False)
    assert hook(tmp_path)(5) == {}
    assert not (tmp_path / "figures").exists()
