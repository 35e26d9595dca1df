"""What decides about the inverter: the drive's modes as a declared machine. Start reading at ``table.py``."""

from model.supervisor.table import supervisor
from model.supervisor.words import Supervisor

__all__ = ["Supervisor", "supervisor"]
