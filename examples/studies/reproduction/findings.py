"""The main findings: the first page of the report, from numbers of the sections behind it."""

from __future__ import annotations

import textwrap

from study_tools.ledger import Ledger


def summary(ledger: Ledger) -> str:
    """Return the main findings; nothing if a section that they rest on was left out.

    Parameters
    ----------
    ledger : Ledger
        With the numbers of all sections.
    """
    texts = {name: number.text for name, number in ledger.numbers.items()}
    try:
        points = TEXT.format(n=texts).split("\n* ")
    except KeyError:
        return ""
    return "\n".join(
        textwrap.fill(f"* {' '.join(point.removeprefix('* ').split())}", 100, subsequent_indent="  ")
        for point in points
    )


TEXT = """\
* Of {n[claims]} statements {n[claims: reproduced]} are reproduced,
  {n[claims: reproduced with the source's step only]} with the source's step only,
  {n[claims: differs]} differ, {n[claims: cannot be judged]} cannot be judged.
* **Tracking.** Both missions are flown; position errors peak at {n[case1: peak position error]} m
  in Case 1 and {n[case2: peak position error]} m in Case 2.
* **Torques** are above the source's bounds by {n[case1: excess over the claimed torque]} % and
  {n[case2: excess over the claimed torque]} %. In Case 2 this rests on where the arm is mounted on
  its base, which the source leaves out: from {n[case2-centroid-at-joint: peak base torque]} to
  {n[case2-mounting: peak base torque]} N·m over the places looked at.
* **The observer and chattering.** With the observer the ripple of the control force is
  {n[case1: force ripple, with over without observer]} (Case 1) and
  {n[case2: force ripple, with over without observer]} (Case 2) times that without: the boundary
  layer makes the law continuous, not the observer.
* **The observer and errors.** It takes the peak position error to
  {n[case1: peak position error, with over without observer]} and
  {n[case2: peak position error, with over without observer]} times that without, the late one to
  {n[case1: late position error, with over without observer]} and
  {n[case2: late position error, with over without observer]} times: it takes the damping from the
  lowest mode, which ends in a limit cycle.
* **SMC.** With the source's step its errors are at least
  {n[case1-smc: least advantage of the proposed law]} and
  {n[case2-smc: least advantage of the proposed law]} times those of the proposed law; with a tenth
  of that step for both at least {n[case1-smc-fine: least advantage of the proposed law]} and
  {n[case2-smc-fine: least advantage of the proposed law]} times. The comparison shows the step as
  much as the law.
* **Theorems.** The bound of Theorem 1 has slack {n[case1: slack of Theorem 1]} and
  {n[case2: slack of Theorem 1]}; σ is {n[case1: slack of sigma]} and {n[case2: slack of sigma]}
  times what it must exceed. V stays far below the ultimate bound of Theorem 2.
* **Modal actuation.** With the work of the actuators on the modes, as in Eq. 42, the rightmost
  oscillating pole (six undamped modes, with observer) is at
  {n[stability: case1, with observer, six modes: pole]} and
  {n[stability: case2, with observer, six modes: pole]} 1/s. Poles and simulated growth agree within
  {n[stability: largest relative difference]} %.
"""
