"""Settings of the whole suite, and the fixtures of the tests that are about the code itself."""

import os
import signal
import tomllib
from pathlib import Path

import campaign
from hypothesis import settings

ROOT = Path(__file__).parents[1]

# Kept from run to run: only tests of the cache itself need an empty one.
os.environ.setdefault("TRUSSFLOW_CACHE", str(ROOT / ".compiled"))

# Before any test imports pyplot: no test may open a window.
os.environ.setdefault("MPLBACKEND", "Agg")

# A suite that a shell started in the background ignores Ctrl-C, and so would the commands that tests start.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Neither has a deadline: the first example of a test often compiles a diagram.
settings.register_profile("dev", max_examples=10, derandomize=True, deadline=None)
settings.register_profile("campaign", max_examples=80 * campaign.SIZE, deadline=None, print_blob=True)
settings.load_profile("dev")


def packages():
    """Return the packages that pyproject.toml lists, and the folder of each."""
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    folders = setuptools["package-dir"]
    found = {}
    for package in setuptools["packages"]:
        top = next(name for name in folders if f"{package}.".startswith(f"{name}."))
        below = package.removeprefix(top).split(".")
        found[package] = ROOT.joinpath(folders[top], *below)
    return found


def pytest_generate_tests(metafunc):
    """Run a test once for each package or module whose import name it asks for."""
    if "package_name" in metafunc.fixturenames:
        metafunc.parametrize("package_name", packages())
    if "module_name" in metafunc.fixturenames:
        modules = (
            f"{package}.{path.stem}"
            for package, folder in packages().items()
            for path in sorted(folder.glob("[!_]*.py"))
        )
        metafunc.parametrize("module_name", [*packages(), *modules])
