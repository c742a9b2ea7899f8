"""Bad files of missions, frames and robots: one clear error each, that says where and what to do."""

import re
import shutil
import tomllib
from pathlib import Path

import pytest
from sources import MISSIONS

from trussflow.models import ModelError, shipped_file
from trussflow.models.transport import MissionFile

BAD = tomllib.loads(
    (Path(__file__).parents[1] / "data" / "bad_files.toml").read_text(encoding="utf-8")
)["bad"]

MISSION = """title = "boom"
extends = "transport.toml"

[structure]
model = "frame"
file = "boom.toml"
grasps = [[1, 2, 3], 14]
modes = 6
damping = "0.5 %"
highest_frequency = "100 Hz"
[[robots]]
arm = "walker.urdf"
hand = "hand"
base = "base"
[[robots]]
arm = "jaco.toml"
[path]
position = "[0, 0, 1] m"
attitude = "[0, 0, 10] deg"
duration = "60 s"

[controller]
law = "mean axes"
observer_bandwidth = "4 1/s"
reaching_gain = "0.3 1/s"

[hardware]
kind = "flight"
seed = 0

[thrusters]
maximum = "5 N"
quantum = "0.1 N"

[wheels]
torque = "0.3 N*m"

[simulation]
duration = "80 s"
step = "2 ms"
log_every = 10
"""


@pytest.fixture
def mission(tmp_path):
    """Return a mission of a boom with another robot at each grasp, beside its files."""
    for name in ("boom.toml", "walker.urdf"):
        shutil.copy(MISSIONS / name, tmp_path)
    shutil.copy(shipped_file("robot_arm_jaco.toml"), tmp_path / "jaco.toml")
    path = tmp_path / "mission.toml"
    path.write_text(MISSION, encoding="utf-8")
    return path


def test_the_mission_is_good_as_it_stands(mission):
    assert MissionFile.read(mission).diagram().blocks


@pytest.mark.parametrize(
    "bad", BAD, ids=[f"{bad['file']}: {bad['after']}" for bad in BAD]
)
def test_a_bad_file_is_one_clear_error(bad, mission):
    file = mission.parent / bad["file"]
    text = file.read_text(encoding="utf-8")
    assert bad["before"] in text
    file.write_text(text.replace(bad["before"], bad["after"], 1), encoding="utf-8")
    if "boom.op4" in bad["after"]:
        pytest.importorskip("pyyeti", reason="pyyeti reads Nastran's files")
    with pytest.raises(ModelError) as caught:
        MissionFile.read(mission).diagram()
    said = str(caught.value).replace(str(mission.parent), "DIR")
    assert re.fullmatch(
        re.escape(bad["message"]).replace(re.escape("..."), ".*"), said
    ), said
