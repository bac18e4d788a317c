import pytest

from hitmdp_jax.errors import UsageError
from hitmdp_jax.figures import catalogue, registry
from hitmdp_jax.figures.registry import Section
from hitmdp_jax.report.run_report import RunReport
from tests.interpret.analyses import analysis_of_embeddings
from tests.report.shown import shown

NEW = '''"""A line through nothing."""

from matplotlib.figure import Figure

from hitmdp_jax.figures.registry import Entry, Needs, Section


def draw(analysis):
    return Figure()


FIGURE = Entry("A new figure", Needs.EPISODES, draw, Section.STATES)
'''


def test_a_new_figure_is_one_new_file(tmp_path, monkeypatch):
    (tmp_path / "lines.py").write_text(NEW)
    monkeypatch.setattr(catalogue, "__path__", [*catalogue.__path__, str(tmp_path)])
    assert registry.summaries()["lines"] == "A line through nothing."
    assert registry.find("lines").title == "A new figure"
    page = RunReport(tmp_path, None, "", 0, shown(analysis_of_embeddings()))  # type: ignore
    assert "<h3>A new figure</h3>" in list(page.options(Section.STATES))


def test_the_figures_of_the_paper_come_first_by_number():
    names = list(registry.summaries())
    assert names[:5] == ["figure5", "figure6", "figure7", "figure8", "figure9"]
    assert names.index("figure14") < names.index("attention")


def test_every_figure_says_what_it_shows():
    assert all(line.endswith(".") for line in registry.summaries().values())
    assert all(entry.title for entry in registry.entries().values())
    with pytest.raises(UsageError, match="Unknown figure 'figure15'; did you mean 'figure5'"):
        registry.find("figure15")
