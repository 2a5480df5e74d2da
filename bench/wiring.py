"""Which element of the analyzer measures what: its items by the columns of the measurement table."""

from bench.config import BenchConfig


def analyzer_columns(config: BenchConfig) -> dict[str, str]:
    """Analyzer item → column of the measurement table, by the wiring."""
    wiring = config.analyzer.wiring
    columns: dict[str, str] = {}
    for port, element in ((1, wiring.input), (2, wiring.output)):
        columns |= {f"U{element}": f"V{port}_V", f"I{element}": f"I{port}_A", f"P{element}": f"P{port}_W"}
    for number, link in ((1, wiring.link1), (2, wiring.link2)):
        if link is not None:
            columns[f"P{link}"] = f"P_link{number}_W"
    if wiring.link1 is not None:
        columns[f"I{wiring.link1}"] = "I_L_rms_A"
    return columns
