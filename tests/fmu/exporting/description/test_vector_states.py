"""States that are arrays, in the model description of FMI 2, which lists their elements."""

from xml.etree import ElementTree

import numpy as np

from trussflow.blocks import Integrator
from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.fmu.exporting.description.model_description import model_description


def test_each_derivative_refers_to_its_own_state():
    description = model_description(
        ExportInterface.of(Integrator(np.zeros(3))), "2.0", {}
    )
    variables = list(ElementTree.fromstring(description).find("ModelVariables"))
    states = {
        variable.get("name"): variables[int(variable[0].get("derivative")) - 1].get(
            "name"
        )
        for variable in variables
        if variable[0].get("derivative")
    }
    assert states == {f"der(integral[{i}])": f"integral[{i}]" for i in (1, 2, 3)}
