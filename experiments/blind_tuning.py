"""The blind trials on the seeds that a diagnosis may be tuned on; what `blind_trials` scores is never among them."""

from experiments.blind.seeds import TUNING
from experiments.blind_trials import NAMES, run_with
from experiments.harness.registry import Experiment
from experiments.harness.result import Result
from experiments.harness.settings import Settings


def run(settings: Settings) -> Result:
    """The same trials with other seeds."""
    return run_with(TUNING, settings)


EXPERIMENT = Experiment(
    title="Blind trials on the seeds for tuning", run=run, parts=NAMES, apart=True, spread=True
)
