"""Planted faults: each of these small faults in the code must fail an ordinary test.

A fault is one replacement in one file. Its test copies the packages, writes the fault into the copy and runs
the named tests against it. If these tests pass, the suite has a gap.
"""

import os
import shutil
import subprocess
import sys
from typing import NamedTuple

import campaign
import pytest
from sources import ROOT, SETUPTOOLS

pytestmark = pytest.mark.campaign

FOLDERS = SETUPTOOLS["package-dir"] | {"studies": "examples/studies"}


class Fault(NamedTuple):
    """A replacement in a file, and the test files that fail with it."""

    file: str
    tests: str
    reason: str
    old: str
    new: str


CONTROL = "tests/blocks/control/test_pid.py tests/models/geometry/test_rotation.py tests/fmu/ssp/test_ssp.py"
"""Tests that must pass with an unchanged copy."""

# fmt: off
FAULTS = (
    Fault("blocks/framework/units.py", "tests/blocks/test_planted_gaps.py",
          "an offset between units counts in one direction only",
          "if zero != 0:", "if zero > 0:"),
    Fault("blocks/framework/netlist.py", "tests/blocks/framework/test_netlist.py",
          "inputs are grounded when the block that drives them is removed",
          "if wire.source is not None:",
          "if wire.source is not None and wire.source.block.name in self.blocks:"),
    Fault("blocks/framework/layout.py", "tests/blocks/simulation/test_simulator_errors.py",
          "the message names the wrong element of a diverged state",
          "int(np.argmax(bad))", "int(np.argmin(bad))"),
    Fault("blocks/framework/signal_injection.py", "tests/blocks/linear_analysis/test_signals.py",
          "an injected slice reaches the wrong elements",
          "driver.given[hits], taken)", "driver.taken[hits], taken)"),
    Fault("blocks/framework/system.py", "tests/blocks/framework/test_diagram.py",
          "a slice of an exposed port becomes the whole port",
          "port = inner if port.index is None else inner[port.index]", "port = inner"),
    Fault("blocks/framework/arithmetic.py", "tests/blocks/framework/test_arithmetic.py",
          "the unit of a quotient is that of a product",
          'np.divide: "{}/{}"', 'np.divide: "{}*{}"'),
    Fault("blocks/support/files.py", "tests/blocks/framework/test_files.py",
          "a lock on a folder no longer excludes other processes",
          "fcntl.LOCK_EX |", "fcntl.LOCK_SH |"),
    Fault("blocks/control/pid.py", "tests/blocks/control/test_pid.py",
          "the filter of the derivative starts with the wrong reference weight",
          '"smooth": signal', '"smooth": u.reference - u.measurement'),
    Fault("blocks/tracing/events.h", "tests/blocks/library/test_transport_delay.py",
          "a delayed jump is smoothed", "1e-7 * tf_largest(h, e", "1e7 * tf_largest(h, e"),
    Fault("blocks/tracing/history.py", "tests/fmu/hybrid/test_hybrid.py",
          "in NumPy, a delayed jump is smoothed", "ROUND_OFF = 1e-9, 1e-7,", "ROUND_OFF = 1e-9, 1e7,"),
    Fault("blocks/library/noise.py", "tests/models/hardware/test_measurement.py",
          "variance of a correlated drift",
          "-expm1(-2.0 * decay)", "-expm1(-decay)"),
    Fault("blocks/library/nonlinear.py", "tests/blocks/library/test_nonlinear.py",
          "the falling rate limit is the rising one",
          "-p.falling * step", "-p.rising * step"),
    Fault("blocks/library/switching.py", "tests/blocks/test_planted_gaps.py",
          "an integrator that left its limit cannot move towards it again",
          "np.where(leaves, 0.0, x.side)", "x.side"),
    Fault("blocks/library/rigid_body.py", "tests/blocks/library/test_rigid_body.py",
          "sign of the gyroscopic torque",
          "np.cross(x.w, momentum)", "np.cross(momentum, x.w)"),
    Fault("blocks/control/sliding_mode.py", "tests/blocks/control/test_sliding_mode.py",
          "exponent of the terminal sliding variable",
          "p.beta / (2.0 - p.beta)", "p.beta"),
    Fault("blocks/tracing/compiler.py", "tests/blocks/tracing/test_compiler_cache.py",
          "the cache key ignores the compiler",
          "(*identity(compiler), *options_for(FLAGS, 0), content)", "(*options_for(FLAGS, 0), content)"),
    Fault("blocks/tracing/memoized.py", "tests/blocks/tracing/test_memoized.py",
          "callers share a memoized array",
          "deepcopy(found[2])", "found[2]"),
    Fault("blocks/tracing/events.h", "tests/blocks/simulation/test_bounces.py",
          "after an event the rest of a step is too long in C",
          "h = end - stop;", "h = whole;"),
    Fault("blocks/tracing/events.h", "tests/blocks/simulation/test_solved_loops.py",
          "solutions of loops are stored in the wrong place",
          "memcpy(d + m->sides + 2 * TF_EVENTS,", "memcpy(d + m->sides + TF_EVENTS,"),
    Fault("blocks/tracing/fixed_step.h", "tests/blocks/simulation/test_fixed_step.py",
          "the last stage of a step sees the jump after it",
          "last = tf_just_before(end)", "last = end"),
    Fault("blocks/tracing/driver.c", "tests/blocks/simulation/test_fixed_step.py",
          "time is summed up step by step",
          "next = (double)(first + k + 1) * numerator / denominator;", "next = t + h;"),
    Fault("blocks/tracing/lanes.h", "tests/blocks/tracing/test_lanes.py",
          "powers with large exponents lose digits",
          "outside(z, -20.0, 20.0)", "outside(z, -700.0, 700.0)"),
    Fault("blocks/tracing/plan.py", "tests/blocks/test_planted_gaps.py",
          "a refused parameter stays changed",
          "flat = present.copy()", "flat = present"),
    Fault("blocks/simulation/run.py", "tests/blocks/test_planted_gaps.py",
          "rows are logged at the wrong steps of later windows",
          "logged[-base % every :: every]", "logged[base % every :: every]"),
    Fault("blocks/simulation/executor.py", "tests/blocks/simulation/test_bounces.py",
          "after an event the rest of a step is too long in Python",
          "            h = end - t\n", "            h = whole\n"),
    Fault("blocks/simulation/adaptive.py", "tests/blocks/library/test_switching.py",
          "adaptive solvers step over time events",
          "stop = c.end if watch is None else min(c.end, watch.next_time())", "stop = c.end"),
    Fault("blocks/tracing/variable_step.h", "tests/blocks/simulation/test_variable_step.py",
          "a Rosenbrock step leaves out the derivative by time",
          "b->slope[i] * h * by_time[j]", "0.0 * b->slope[i] * h * by_time[j]"),
    Fault("blocks/tracing/variable_step.py", "tests/blocks/simulation/test_variable_step.py",
          "elements of L and U are exchanged",
          "fill.nnz() * (i > j)", "fill.nnz() * (i < j)"),
    Fault("blocks/simulation/session.py", "tests/blocks/simulation/test_session_errors.py",
          "a session that failed cannot go on after restore()",
          "raise\n        self.fault = \"\"", "raise"),
    Fault("blocks/simulation/step_size_warnings.py", "tests/blocks/simulation/test_jumping_inputs.py",
          "no warning of a jump within a step",
          "(b / step).denominator != 1", "(b / step).denominator == 1"),
    Fault("blocks/testing/energy_audit.py", "tests/blocks/testing/test_energy_audit.py",
          "delivered power counts as supplied",
          "[-1.0] * len(account.delivered)", "[1.0] * len(account.delivered)"),
    Fault("blocks/results/streamed_log.py", "tests/blocks/simulation/test_streamed_log.py",
          "rows after the checkpoint stay and appear twice",
          "if int(old.stem) >= self._first:", "if int(old.stem) > self._first:"),
    Fault("blocks/results/state_file.py", "tests/blocks/simulation/test_state_bytes.py",
          "a state of a diagram with more settings is accepted",
          "for name in {**here, **there} if", "for name in here if"),
    Fault("blocks/cosimulation/step_control.py", "tests/blocks/cosimulation/test_step_control.py",
          "a rejected step is not rolled back",
          "if ratio > 1.0:\n                coupled.restore(saved)\n", "if ratio > 1.0:\n"),
    Fault("blocks/cosimulation/coupling.py", "tests/blocks/cosimulation/test_convergence.py",
          "later members read the outputs of before",
          "values = np.where(use, self.signals[network.gather[own]], values)", "pass"),
    Fault("blocks/cosimulation/fixed_point.py", "tests/blocks/cosimulation/test_loops.py",
          "an iteration ends where one signal has converged",
          "(relative <= tolerance).all()", "(relative <= tolerance).any()"),
    Fault("blocks/linear_analysis/margins.py", "tests/blocks/linear_analysis/test_loop_transfer.py",
          "the lower gain margin is the farthest one",
          "gm[gm < 1].max(initial=0.0)", "gm[gm < 1].min(initial=1.0)"),
    Fault("blocks/linear_analysis/lifting.py", "tests/blocks/linear_analysis/test_lifting.py",
          "the feedthrough of sampled outputs is lost",
          "C @ first[1] + D", "C @ first[1]"),
    Fault("blocks/linear_analysis/trim.py", "tests/blocks/linear_analysis/test_trim.py",
          "wanted rates have the opposite sign",
          "model[:size] - wanted)", "model[:size] + wanted)"),
    Fault("blocks/linear_analysis/loop_transfer.py", "tests/blocks/linear_analysis/test_loop_transfer.py",
          "complementary sensitivity is the sensitivity",
          "(-C, D @ model.D)", "(C, D @ model.D)"),
    Fault("blocks/linear_analysis/frequency/delays.py",
          "tests/blocks/linear_analysis/frequency/test_delays.py",
          "phase of the loop gain is not counted from -1",
          "np.angle(gain) + np.pi", "np.angle(gain)"),
    Fault("blocks/linear_analysis/frequency/estimated_response.py",
          "tests/blocks/linear_analysis/frequency/test_estimated_response.py",
          "estimated transfer matrix is transposed",
          "solve(U, Y).transpose(2, 1, 0)", "solve(U, Y).transpose(1, 2, 0)"),
    Fault("blocks/linear_analysis/uncertainty/robust_stability.py",
          "tests/blocks/linear_analysis/uncertainty/test_robust_stability.py",
          "a proof of stability ignores negative parameters",
          "0.0 if even else -each[0]", "0.0"),
    Fault("blocks/linear_analysis/uncertainty/gain_series.py",
          "tests/blocks/linear_analysis/uncertainty/test_uncertainty.py",
          "even terms shift the middle of the bound by a quarter",
          "[1:], axis=0) / 2.0", "[1:], axis=0) / 4.0"),
    Fault("blocks/sweeps/chunk_store.py", "tests/blocks/sweeps/test_sweep_faults.py",
          "results of other settings are those of a sweep",
          "for key in identity if", 'for key in ("keep", "vary") if'),
    Fault("blocks/linear_analysis/uncertainty/uncertain_model.py",
          "tests/blocks/linear_analysis/uncertainty/test_uncertainty.py",
          "mixed second differences of an uncertain model",
          "np.sum(corners, axis=0) / 4.0", "np.sum(corners, axis=0) / 2.0"),
    Fault("blocks/control/covariances.py", "tests/blocks/control/test_kalman_design.py",
          "the transition matrix of a sampled covariance is transposed",
          "turned = flow[n:, n:].T", "turned = flow[n:, n:]"),
    Fault("blocks/control/kalman_filter.py", "tests/blocks/control/test_kalman_filters_in_runs.py",
          "the prediction uses the undelayed command",
          "given[self.behind : self.late]", "given[self.behind + 1 :]"),
    Fault("blocks/control/process_models.py", "tests/blocks/control/test_extended_kalman_filter.py",
          "weight of the middle of Simpson's rule",
          "4 * second @ Q", "2 * second @ Q"),
    Fault("blocks/control/kalman_design.py", "tests/blocks/control/test_kalman_design.py",
          "density of a Gauss-Markov disturbance",
          "2 * one.standard_deviation**2 / one.time_constant",
          "one.standard_deviation**2 / one.time_constant"),
    Fault("blocks/drawing/ordering.py", "tests/blocks/drawing/test_layout.py",
          "the rail is left of the wrong rail",
          "number += min(cuts(a, b), cuts(b, a))", "number += max(cuts(a, b), cuts(b, a))"),
    Fault("blocks/sweeps/tangents.py", "tests/blocks/sweeps/test_tangents.py",
          "shifts of successive event times do not add up",
          "self._time = time + lengths[0]", "self._time = self._length + lengths[0]"),
    Fault("blocks/sweeps/variations.py", "tests/blocks/sweeps/test_variations.py",
          "the covariance of a joint distribution is transposed",
          "stats.norm.ppf(own) @ spread.T", "stats.norm.ppf(own) @ spread"),
    Fault("blocks/sweeps/samples.py", "tests/blocks/simulation/test_lanes_of_runs.py",
          "states of a batch do not start at their parameters",
          "target[:, state.start : state.stop] = p[:, start.start : start.stop]", "pass"),
    Fault("blocks/simulation/lanes.py", "tests/blocks/simulation/test_lanes_of_runs.py",
          "the last instant of a batch is not logged",
          "(ticks % self._every == 0) | (ticks == self._last)", "ticks % self._every == 0"),
    Fault("blocks/simulation/pacing.py", "tests/blocks/simulation/test_pacing.py",
          "a run waits as if its pace were one",
          "self._zero + now / self.pace", "self._zero + now"),
    Fault("blocks/sweeps/tuning.py", "tests/blocks/sweeps/test_tuning.py",
          "limits are met from the wrong side",
          "(most - found) / _size(most)", "(found - most) / _size(most)"),
    Fault("blocks/command_line/run.py", "tests/blocks/command_line/test_command.py",
          "the least value is the last",
          "values.min(skipna=False)", "values.iloc[-1]"),
    Fault("fmu/exporting/description/dependencies.py", "tests/fmu/exporting/description/test_interface.py",
          "a parameter of rates only is fixed",
          "np.vstack([rate, output, *sampled, *events])", "np.vstack([output, *sampled, *events])"),
    Fault("fmu/exporting/native/core.c", "tests/fmu/exporting/native/test_states.py",
          "outputs are stale after a state is restored",
          "memcpy(&c->s, saved, sizeof(tf_state));\n  tf_touch(c);\n",
          "memcpy(&c->s, saved, sizeof(tf_state));\n"),
    Fault("fmu/exporting/description/groups.py", "tests/fmu/exporting/description/test_interface.py",
          "value references of arrays overlap",
          "reference += variable.size", "reference += 1"),
    Fault("fmu/exporting/description/groups.py", "tests/fmu/exporting/description/test_interface.py",
          "outputs of sampled blocks are continuous",
          '"discrete" if held else "continuous"', '"continuous" if held else "continuous"'),
    Fault("fmu/exporting/description/variables.py", "tests/fmu/exporting/description/test_vector_states.py",
          "all derivatives refer to the first state",
          "else self.state + i", "else self.state"),
    Fault("fmu/exporting/description/dependencies.py", "tests/fmu/exporting/description/test_interface.py",
          "outputs read between instants have no dependencies of their own",
          "            output,\n            *(rest |", "            *(rest |"),
    Fault("fmu/exporting/native/core.c", "tests/fmu/exporting/native/test_misuse.py",
          "an input that is not finite is an error instead of discarded",
          "why ? TF_ERROR : TF_DISCARD", "TF_ERROR"),
    Fault("fmu/exporting/native/fmi3.c", "tests/fmu/exporting/native/test_states.py",
          "a discarded step of FMI 3 is not rolled back",
          "tf_communication_step(c, time, step, 1)", "tf_communication_step(c, time, step, 0)"),
    Fault("fmu/exporting/native/source.py", "tests/fmu/exporting/native/test_variable_steps.py",
          "the automatic choice of an FMU stays with the explicit method",
          '"TF_AUTOMATIC": control.automatic', '"TF_AUTOMATIC": 0'),
    Fault("fmu/exporting/native/time.c", "tests/fmu/exporting/native/test_variable_steps.py",
          "the absolute tolerance of an FMU equals the relative one",
          "0.01 * control->rtol", "control->rtol"),
    Fault("fmu/exporting/python/instance.py", "tests/fmu/exporting/python/test_states.py",
          "inputs that no step has used are lost from saved states",
          "            self._apply()\n            snapshot", "            snapshot"),
    Fault("fmu/exporting/python/payload.py", "tests/fmu/exporting/python/test_mixing.py",
          "a class of the user in this process is changed in place",
          "make(*shape, None, extra)", "make(*shape, _identifier, extra)"),
    Fault("fmu/exporting/plain_c/plain_files.py", "tests/fmu/exporting/test_plain_c.py",
          "outputs do not show an input that was just set",
          "sizeof(double));\\n  m->known = 0;\\n", "sizeof(double));\\n"),
    Fault("fmu/exporting/python/instance.py", "tests/fmu/exporting/python/test_states.py",
          "a state saved before the initialization is restored as running",
          "self._running = snapshot is not None", "self._running = True"),
    Fault("fmu/importing/model_exchange_run.py", "tests/fmu/importing/test_events.py",
          "an FMU whose run starts late is initialized at time zero",
          "time != self._begun:", "time < self._begun:"),
    Fault("fmu/runtime/loaded_co_simulation.py", "tests/fmu/importing/test_loaded_co_simulation.py",
          "an input that jumps is not written after a restored state",
          "        self._written = None  # the discrete inputs in the state are unknown\n", ""),
    Fault("fmu/runtime/loaded_model_exchange.py", "tests/fmu/importing/test_events.py",
          "discrete inputs are stale after a restored state",
          "self.next_time = next_time\n        self._input.values[:] = inputs", "self.next_time = next_time"),
    Fault("fmu/runtime/variable_buffers.py", "tests/fmu/importing/test_values.py",
          "the first number beyond an integer type passes",
          "(given < float(high + 1))", "(given <= float(high + 1))"),
    Fault("fmu/runtime/safe_xml.py", "tests/fmu/importing/test_bad_fmus.py",
          "entities of a document are expanded",
          "    parser.StartDoctypeDeclHandler = refuse\n    parser.EntityDeclHandler = refuse\n", ""),
    Fault("fmu/ssp/writing.py", "tests/fmu/ssp/test_ssp.py",
          "start values of FMUs are not written",
          "interface.starts | grounded", "grounded"),
    Fault("models/truss/truss_terms.py", "tests/models/truss/test_truss_terms.py",
          "Coriolis torque with a transposed matrix",
          "flow.T @ omega", "flow @ omega"),
    Fault("models/truss/truss_modes.py", "tests/models/truss/test_variations.py",
          "rotations of the grasps keep the modes without load",
          '("shapes", "grasp_translations", "grasp_rotations")', '("shapes", "grasp_translations")'),
    Fault("models/truss/structure.py", "tests/models/truss/test_structure.py",
          "rotations in matrices have the unit of lengths",
          "np.tile([1.0, 1.0, 1.0, length, length, length]", "np.tile([1.0, 1.0, 1.0, 1.0, 1.0, 1.0]"),
    Fault("models/truss/frame.py", "tests/models/truss/test_frame.py",
          "torsion constant of a tube",
          "np.full(2, moment), 2.0 * moment", "np.full(2, moment), moment"),
    Fault("models/robots/hand_motion.py", "tests/models/robots/test_hand_motion.py",
          "sign of an acceleration of the grasp point",
          "np.cross(translation @ modal_rates, turning @ modal_rates)",
          "np.cross(turning @ modal_rates, translation @ modal_rates)"),
    Fault("models/robots/robot_arm.py", "tests/models/robots/test_robot_arm.py",
          "a sliding arm passes for a turning one",
          '"sliding", "drive_inertias"}', '"drive_inertias"}'),
    Fault("models/mean_axes/law.py", "tests/models/mean_axes/test_modal_damping.py",
          "sign of the damping of the modes",
          "-2 * p.modal_damping", "2 * p.modal_damping"),
    Fault("models/mean_axes/free_modes.py", "tests/models/mean_axes/test_free_modes.py",
          "damping ratio of the free modes",
          "/ (2.0 * frequencies)", "/ frequencies"),
    Fault("models/geometry/rotation.py", "tests/models/plant/test_nominal_model.py",
          "sign in the derivative of the rate matrix",
          "-by_phi * c_theta - by_theta * s_theta", "-by_phi * c_theta + by_theta * s_theta"),
    Fault("models/dynamics/dynamics.py", "tests/models/dynamics/test_dynamics_conservation.py",
          "angular momentum about the wrong point",
          "rotation @ about_truss[3:] + np.cross(q[:3], linear)", "rotation @ about_truss[3:]"),
    Fault("models/dynamics/task_space.py", "tests/models/plant/test_nominal_model.py",
          "sign of the drift of the task velocity",
          "np.cross(speeds[3:6], speeds[:3])", "np.cross(speeds[:3], speeds[3:6])"),
    Fault("models/feasibility/failures.py", "tests/models/feasibility/test_reach.py",
          "the joints of the next robot fail",
          "in dynamics.arms[: robot - 1]", "in dynamics.arms[:robot]"),
    Fault("models/feasibility/fastest.py", "tests/models/feasibility/test_fastest.py",
          "acceleration at the end of each piece of a path",
          "- 3.0 * rate + bend / 2.0) / h**5", "- 3.0 * rate + bend) / h**5"),
    Fault("models/hardware/thrusters.py", "tests/models/hardware/test_thrusters.py",
          "propellant is counted from the true thrust",
          "np.sum(valves) / self.exhaust_speed", "np.sum(thrust) / self.exhaust_speed"),
    Fault("models/hardware/hardware.py", "tests/models/hardware/test_gyroscopic.py",
          "sign of the gyroscopic torque of wheels",
          "felt = felt + gyroscope.torque", "felt = felt - gyroscope.torque"),
    Fault("models/mean_axes/allocation.py", "tests/models/mean_axes/test_allocation.py",
          "failed actuators keep their limits",
          "reach = p.limits * u.effectiveness", "reach = p.limits"),
    Fault("models/mean_axes/fault_detection.py", "tests/models/mean_axes/test_fault_detection.py",
          "the joints judge the base of a held arm",
          "np.where(held, frame_lost, both[:, :robots])", "both[:, :robots]"),
    Fault("models/mean_axes/validity.py", "tests/models/mean_axes/test_validity.py",
          "poses are rejected for ever after a long outage",
          "np.logical_or(near, x.coasting > LONGEST_OUTAGE)", "near"),
    Fault("models/plant/space_truss.py", "tests/models/plant/test_energy_audit.py",
          "power of the modal damping",
          "(2 * p.damping_ratio * omega * x.v[rigid:])", "(p.damping_ratio * omega * x.v[rigid:])"),
    Fault("blocks/linear_analysis/modal_table.py", "tests/blocks/linear_analysis/test_linearize.py",
          "left eigenvectors are not conjugated",
          "found[1].T.conj()", "found[1].T"),
    Fault("models/truss/natural_frequencies.py", "tests/models/truss/test_natural_frequencies.py",
          "bodies on the nodes have no mass",
          "structure.mass + added", "structure.mass"),
    Fault("models/transport/summary.py", "tests/models/transport/test_summary.py",
          "the norm of the estimation error is its largest component",
          "largest_norm(\n            (result", "largest_component(\n            (result"),
    Fault("models/transport/mission.py", "tests/models/transport/test_mission.py",
          "weights of actuators are in the wrong order",
          "np.tile(self.weights, robots)", "np.repeat(self.weights, robots)"),
    Fault("models/reporting/metrics.py", "tests/studies/reproduction/test_measures.py",
          "the late part is the first part",
          "time >= time[-1] - window", "time <= window"),
    Fault("examples/studies/flight/samples.py", "tests/studies/flight/test_monte_carlo.py",
          "a sample of the truss has the wrong frequencies",
          "frequency=1.0 + frequency", "frequency=1.0 + mass"),
    Fault("examples/studies/flight/limits.py", "tests/studies/flight/test_limits.py",
          "a bisection ends at once",
          "max(best / worst, worst / best) < MAX_BRACKET_RATIO", "best / worst < MAX_BRACKET_RATIO"),
    Fault("examples/studies/study_tools/stability.py", "tests/studies/reproduction/test_slow_mode.py",
          "gain of a power of a sine",
          "math.gamma(exponent / 2 + 1.5)", "math.gamma(exponent / 2 + 1)"),
    Fault("examples/studies/study_tools/ledger.py", "tests/models/reporting/test_ledger.py",
          "percentages are shares",
          '100 * value if unit == "%" else value', "value"),
    Fault("blocks/support/packing.py", "tests/models/viewer/test_page.py",
          "numbers of charts are cut off instead of rounded",
          "np.round(np.ldexp", "np.floor(np.ldexp"),
    Fault("models/parameter_files.py", "tests/models/test_parameter_files.py",
          "a value is converted into the unit it already has",
          "factor(given, unit))", "factor(unit, given))"),
)
# fmt: on


@pytest.fixture(scope="module")
def packages_copy(tmp_path_factory):
    """Copy the packages to where a path of imports finds them."""
    copy, skipped = (
        tmp_path_factory.mktemp("packages"),
        shutil.ignore_patterns("__pycache__"),
    )
    for package, folder in sorted(FOLDERS.items()):
        place = copy.joinpath(*package.split("."))
        shutil.copytree(ROOT / folder, place, ignore=skipped, dirs_exist_ok=True)
    return copy


def copied(copy, file):
    """Return the path of a file of the repository in the copy of the packages."""
    package, folder = max(
        (
            (package, folder)
            for package, folder in FOLDERS.items()
            if file.startswith(f"{folder}/")
        ),
        key=lambda pair: len(pair[1]),
    )
    return copy.joinpath(*package.split("."), file.removeprefix(f"{folder}/"))


def run(copy, tests):
    """Run test files against the copy of the packages, up to the first failure."""
    environment = {
        name: value for name, value in os.environ.items() if name != "PYTEST_ADDOPTS"
    }
    environment["PYTHONPATH"] = str(copy)  # found before the editable installation
    environment["TRUSSFLOW_CFLAGS"] = "-O0"  # as `make test`
    paths = f"pythonpath=tests {copy}/studies {copy}/studies/modes"
    options = ["-x", "-q", "-p", "no:cacheprovider", "-o", paths]
    command = [sys.executable, "-m", "pytest", *options, *tests.split()]
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True
    )


def test_no_fault_passes(packages_copy):
    done = run(packages_copy, CONTROL)
    assert done.returncode == pytest.ExitCode.OK, done.stdout


# The campaign of CI tries every eighth fault; a larger one tries all.
CHOSEN = FAULTS[campaign.SEED % 8 :: 8] if campaign.SIZE == 1 else FAULTS


@pytest.mark.parametrize(
    "fault", CHOSEN, ids=lambda fault: f"{fault.file}: {fault.reason}"
)
def test_a_fault_fails_a_test(packages_copy, fault):
    source = (ROOT / fault.file).read_text(encoding="utf-8")
    assert source.count(fault.old) == 1
    place = copied(packages_copy, fault.file)
    place.write_text(source.replace(fault.old, fault.new), encoding="utf-8")
    try:
        done = run(packages_copy, fault.tests)
    finally:
        place.write_text(source, encoding="utf-8")
    # A negative code is that of a signal: the fault crashed the process of the tests.
    crashed = done.returncode < 0
    assert crashed or done.returncode == pytest.ExitCode.TESTS_FAILED, done.stdout
