"""Runs scripts and commands in forks of one process that has imported the libraries: an import takes 2 s."""

import multiprocessing
import os
import runpy
import sys

TIME_LIMIT = 300  # s; for scripts that hang, not for slow ones
CONTEXT = multiprocessing.get_context("forkserver" if os.name == "posix" else "spawn")
CONTEXT.set_forkserver_preload(
    [
        "matplotlib.pyplot",
        "control",
        "trussflow.blocks",
        "trussflow.models",
        "trussflow.fmu",
    ]
)


def run(program, folder, arguments=()):
    """Run a script (a path) or a module (its name) in a folder; return its standard output."""
    outputs = [folder / "stdout.txt", folder / "stderr.txt"]
    process = CONTEXT.Process(
        target=_run, args=(program, folder, list(arguments), outputs, dict(os.environ))
    )
    process.start()
    process.join(TIME_LIMIT)
    if process.is_alive():
        process.kill()
        process.join()
    printed, errors = [output.read_text(encoding="utf-8") for output in outputs]
    assert process.exitcode == 0, printed + errors
    return printed


def _run(program, folder, arguments, outputs, environment):
    os.environ.update(environment)  # that of the server is older
    for descriptor, output in enumerate(outputs, 1):
        os.dup2(os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), descriptor)
    os.chdir(folder)
    sys.argv = [str(program), *arguments]
    if isinstance(program, str):
        runpy.run_module(program, run_name="__main__", alter_sys=True)
    else:
        runpy.run_path(str(program), run_name="__main__")
