"""Every file of the package is found, and is what the registry promises."""

from pathlib import Path

import pytest

import experiments
from experiments.harness.registry import Experiment, UnknownExperiment, entry, names


def test_every_file_beside_the_command_is_an_experiment() -> None:
    files = {path.stem for path in Path(experiments.__path__[0]).glob("*.py")}
    assert set(names()) == files - {"__init__", "command"}
    assert {"blind_trials", "simulator_benchmark"} <= set(names())


@pytest.mark.parametrize("name", names())
def test_every_experiment_has_a_title_and_says_what_it_does(name: str) -> None:
    found = entry(name)
    assert isinstance(found.experiment, Experiment)
    assert found.experiment.title
    assert found.about


def test_an_unknown_name_is_answered_with_the_nearest() -> None:
    with pytest.raises(UnknownExperiment, match="did you mean 'blind_trials'"):
        entry("blind_trial")


def test_a_new_file_is_found_and_one_without_declaration_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "fig_0_nothing.py").write_text('"""Nothing."""\n')
    monkeypatch.setattr(experiments, "__path__", [*experiments.__path__, str(tmp_path)])
    assert "fig_0_nothing" in names()
    with pytest.raises(TypeError, match=r"experiments/fig_0_nothing\.py needs"):
        entry("fig_0_nothing")
