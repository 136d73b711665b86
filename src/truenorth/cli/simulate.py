"""``truenorth simulate``: raw data with known truth, from a scenario."""

from __future__ import annotations

from pathlib import Path

__all__ = ["list_scenarios", "simulate_scenario"]


def list_scenarios(*, as_json: bool = False) -> None:
    """Print the scenarios of the package with one line each."""
    import json

    from ..simulation import read_scenario, scenario_names

    known = [read_scenario(name) for name in scenario_names()]
    if as_json:
        print(json.dumps([{"name": s.name, "title": s.title, "source": s.source} for s in known], indent=2))
        return
    width = max(len(scenario.name) for scenario in known)
    for scenario in known:
        print(f"{scenario.name:<{width}}  {scenario.title}")


def simulate_scenario(scenario: str, out: Path, overrides: list[str], *, as_json: bool = False) -> None:
    """Simulate a scenario into a folder and say what is there.

    Parameters
    ----------
    scenario : str
        Name or TOML file.
    out : Path
        The folder.
    overrides : list of str
        ``key=value``.
    as_json : bool
        Tell it as JSON.
    """
    import json

    from ..simulation import read_scenario, write_simulation
    from .progress import working

    described = read_scenario(scenario, overrides)
    with working(f"simulating {described.name}") as progress:
        written = write_simulation(described, out, progress=progress)
    if as_json:
        print(
            json.dumps(
                {
                    "scenario": described.name,
                    "session": str(written.session) if written.session else None,
                    "observations": {
                        name: [str(p) for p in paths] for name, paths in written.observations.items()
                    },
                    "navigation": [str(path) for path in written.navigation],
                    "truth": str(written.truth),
                    "sensors": {name: [str(p) for p in paths] for name, paths in written.sensors.items()},
                    "epochs": written.n_epochs,
                    "rows": written.n_rows,
                    "seconds": round(written.seconds, 3),
                },
                indent=2,
            )
        )
        return
    print(f"scenario    {described.name}: {described.title}")
    if described.source:
        print(f"source      {described.source}")
    for text in described.assumes:
        print(f"assumed     {text}")
    if written.observations:
        print(f"epochs      {written.n_epochs} at {described.interval_s:g} s, {written.n_rows} observations")
    for name, paths in {**written.observations, **written.sensors}.items():
        print(f"{name:<11} " + ", ".join(str(path) for path in paths))
    if written.navigation:
        print("orbits      " + ", ".join(str(path) for path in written.navigation))
    print(f"truth       {written.truth}")
    if written.session:
        print(f"session     {written.session}: solve it with `truenorth solve {written.session}`")
    print(f"time        {written.seconds:.1f} s")
