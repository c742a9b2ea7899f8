"""Diagrams of FMUs as system structures (SSP); an optional part, which nothing else imports."""

from trussflow.fmu.ssp.reading import import_ssp as import_ssp
from trussflow.fmu.ssp.writing import export_ssp as export_ssp
