"""Feasibility of paths with limited and failed actuators, by linear programmes."""

from trussflow.models.feasibility.attitude import BestAttitude as BestAttitude
from trussflow.models.feasibility.attitude import attitude_along as attitude_along
from trussflow.models.feasibility.attitude import best_attitude as best_attitude
from trussflow.models.feasibility.failures import ActuatorFailure as ActuatorFailure
from trussflow.models.feasibility.failures import single_failures as single_failures
from trussflow.models.feasibility.fastest import FastestPath as FastestPath
from trussflow.models.feasibility.fastest import fastest as fastest
from trussflow.models.feasibility.reach import Feasibility as Feasibility
from trussflow.models.feasibility.reach import shares_left as shares_left
from trussflow.models.feasibility.reach import survey as survey
from trussflow.models.feasibility.truss_path import TrussPath as TrussPath
