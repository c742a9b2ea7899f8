"""Report on Monte Carlo samples of Case 1 with each control law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr
from study_tools.evidence import write_report
from study_tools.ledger import Ledger

from flight import tuning
from flight.campaigns import Campaign
from flight.loops import LAWS, law_simulator
from flight.metrics import (
    LATE_WINDOW,
    MAX_JOINTS,
    MAX_LATE_POSITION,
    MAX_POSITION,
    median_and_worst,
    successful,
    table,
    tracking,
)
from flight.samples import (
    MAX_DAMPING,
    MAX_DEVIATION,
    MAX_PAYLOAD,
    MIN_DAMPING,
    UNCERTAINTIES,
    deviations,
    run_parameters,
    sample_parameters,
)
from trussflow.blocks.sweeps.tuning import Tuned
from trussflow.models.reporting.figures import Curve, Panel, drawing, save
from trussflow.models.reporting.metrics import DEFINITIONS, largest_component, late_part

FIRST_SEED = 1000
"""First seed; smaller ones were used for tuning or for the other report."""

RUN_DURATION = 80.0
"""Simulated time: 60 s of motion, then 20 s at rest [s]."""

SHOWN = ("position", "attitude", "joints", "late position", "late force")

STUDIES = (
    ("published", False),
    ("published", True),
    ("mode-neutral", False),
    ("mode-neutral", True),
    ("mean axes", True),
)
"""Laws, and whether they have the reference hardware or exact hardware."""

TEXT = """\
# Monte Carlo comparison of the control laws

Success of each law in Case 1 for {count} samples of the truss. The controllers have the nominal truss. Mass and
frequencies deviate from it by up to {deviation:.0%}, mode shapes at the grasps with a standard deviation of up to
{deviation:.0%}; the damping ratio is {min_damping:.1%} to {max_damping:.0%}, and the payload at the tip up to
{payload:g} kg. *Exact*: exact states and a sample time of 1 ms, on the plant of the law. *Reference hardware*:
the default hardware of [docs/flight](../flight/README.md), with geared drives and a servo; the mean-axes
controller has the accurate plant. A sample is successful if the position error is at most {position:g} mm, joint
errors are at most {joints:g} rad, and the late position error in the last second of {duration:g} s is below
{late:g} mm.

`PYTHONPATH=examples/studies python -m flight --samples {count} --output docs/sweep` writes this report
(`make sweep` with 1000 samples). Every number is in [`evidence.json`](evidence.json) with its full value,
beside the fingerprints of the simulated diagrams; the same command with `--check` compares them with the
present code.

## Success rates

{rates}

The confidence intervals are 95 % Wilson intervals. The next table has the errors of the successful samples.

{definitions}

{errors}

![Distribution of the position error](samples.png)

## Tuning

{tuning}

## Sensitivity

Rank correlations (Spearman) of the uncertainties with the position errors of the successful samples; beyond
±{significant:.2f} they are significant.

{correlations}

## Worst samples

The sample with the largest position error of each law, among the successful ones if there are any.
`sample_parameters` and `noise_parameters` reproduce truss and noise from the seed.

{worst}
"""


def all_campaigns(count: int) -> list[Campaign]:
    """Return the campaigns of all `STUDIES`, with `count` samples each."""
    found, seeds = [], range(FIRST_SEED, FIRST_SEED + count)
    for law, hardware in STUDIES:
        plant = LAWS[law].truss()
        found.append(
            Campaign(
                section=law,
                name=f"{law}, {'reference hardware' if hardware else 'exact'}",
                loop=law_simulator,
                options={"law": law, "reference_hardware": hardware},
                rows=[
                    (run_parameters if hardware else sample_parameters)(plant, seed)
                    for seed in seeds
                ],
                labels=seeds,
                keep=errors,
                duration=RUN_DURATION,
            )
        )
    return found


def make_report(count: int, output: Path, runs: Path, workers: int | None) -> Path:
    """Simulate what is missing, write the report, and return its file.

    Parameters
    ----------
    count : int
        Number of samples of each law [-].
    output, runs : pathlib.Path
        Folders of the report and of the finished runs.
    workers : int, optional
        Number of parallel runs, as for `sweep` [-].
    """
    found = {
        one.name: with_uncertainties(
            one.run(runs, workers=workers),
            LAWS[one.section].truss().dynamics.modes.modes,
        )
        for one in all_campaigns(count)
    }
    tuned = tuning.tuned_designs(runs, workers)
    return write(found, *tuned, output, fingerprints())


def fingerprints() -> dict[str, list[float]]:
    """Return the fingerprints of all simulated loops, by campaign, with the first sample of each law."""
    found = {one.name: one.fingerprint() for one in all_campaigns(1)}
    return found | {"tuning": tuning.loop_fingerprints()}


def errors(run: xr.Dataset) -> dict[str, float]:
    """Return tracking errors and late force of a run."""
    late = run["truss.base_force"].values[late_part(run["time"].values, LATE_WINDOW)]
    return tracking(run) | {"late force": largest_component(late)}


def with_uncertainties(found: xr.Dataset, modes: int) -> xr.Dataset:
    """Return results with the success and the `UNCERTAINTIES` of each sample; shapes as root mean square."""
    drawn = [deviations(int(seed), modes) for seed in found["sample"].values]
    for one in drawn:
        one["shapes"] = float(np.sqrt(np.mean(np.square(one["shapes"]))))
    columns = {name: ("sample", [one[name] for one in drawn]) for name in UNCERTAINTIES}
    return found.assign(columns).assign(successful=successful(found))


def success_rate(succeeded: npt.NDArray[np.bool_]) -> tuple[float, float, float]:
    """Return the success rate and its 95 % confidence interval by Wilson [-]."""
    from scipy.stats import binomtest

    interval = binomtest(int(np.sum(succeeded)), len(succeeded)).proportion_ci(
        method="wilson"
    )
    return float(np.mean(succeeded)), float(interval.low), float(interval.high)


def correlations(succeeded: xr.Dataset, metric: str) -> dict[str, float]:
    """Return the rank correlation of a metric with each uncertainty [-]; NaN for fewer than three samples."""
    from scipy.stats import spearmanr

    if succeeded.sizes["sample"] < 3:
        return dict.fromkeys(UNCERTAINTIES, np.nan)
    return {
        name: float(spearmanr(succeeded[name], succeeded[metric]).statistic)
        for name in UNCERTAINTIES
    }


def write(
    found: Mapping[str, xr.Dataset],
    tuned: Tuned,
    designs: tuning.Designs,
    folder: Path,
    recorded: Mapping[str, Sequence[float]],
) -> Path:
    """Write report, figure and evidence, and return the file of the report.

    Parameters
    ----------
    found : mapping
        Results by name of the campaign, by `with_uncertainties`.
    tuned, designs
        Results of `tuned_designs`.
    folder : pathlib.Path
        Folder of the report.
    recorded : mapping
        Fingerprints by name of the campaign.
    """
    folder.mkdir(parents=True, exist_ok=True)
    ledger, count = Ledger(), next(iter(found.values())).sizes["sample"]
    rates, rows, ranks, worst, curves = {}, {}, {}, {}, []
    for (law, _), (name, data) in zip(STUDIES, found.items(), strict=True):
        note = ledger.of(name)
        rate, low, high = success_rate(data["successful"].values)
        least, most = (
            note("rate, from", low, "%"),
            note("rate, to", high, "%", digits=4),
        )
        rates[name] = {
            "law": name,
            "plant": LAWS[law].label,
            "successful": int(data["successful"].sum()),
            "rate": note("rate", rate, "%"),
            "confidence interval": f"{least} to {most}",
        }
        succeeded = data.isel(sample=np.flatnonzero(data["successful"].values))
        if succeeded.sizes["sample"]:
            rows[name] = {"law": name, **median_and_worst(succeeded[list(SHOWN)])}
            for metric in ("position", "late position"):
                ranks[f"{name}, {metric}"] = {
                    "law": name,
                    "error": metric,
                    **{
                        what: note(f"{metric} by {what}", one, digits=2)
                        for what, one in correlations(succeeded, metric).items()
                    },
                }
        candidates = succeeded if succeeded.sizes["sample"] else data
        one = candidates.isel(
            sample=int(np.argmax(candidates["position"].fillna(np.inf).values))
        )
        worst[f"{name}, worst sample"] = {
            "law": name,
            "seed": int(one["sample"]),
            **{f"{what} [{unit}]": one[what] for what, unit in UNCERTAINTIES.items()},
            "position": one["position"],
        }
        values = np.sort(1e3 * data["position"].fillna(np.inf).values)
        curves.append(Curve(name, values, np.arange(1, count + 1) / count))
    panel = Panel(
        curves=curves,
        x="largest position error [mm]",
        y="share of samples [-]",
        log_x=True,
        marks=[1e3 * MAX_POSITION],
        legend_inside=True,
    )
    save(drawing([panel], row_height=3.2), folder / "samples.png", small=True)
    text = TEXT.format(
        count=count,
        deviation=MAX_DEVIATION,
        min_damping=MIN_DAMPING,
        max_damping=MAX_DAMPING,
        payload=MAX_PAYLOAD,
        position=1e3 * MAX_POSITION,
        joints=MAX_JOINTS,
        late=1e3 * MAX_LATE_POSITION,
        duration=RUN_DURATION,
        significant=2 / np.sqrt(count),
        definitions=DEFINITIONS,
        rates=table(ledger, rates),
        errors=table(ledger, rows),
        tuning=tuning.section(tuned, designs, ledger),
        correlations=table(ledger, ranks),
        worst=table(ledger, worst),
    )
    return write_report(folder, text, ledger, recorded, samples=count)
