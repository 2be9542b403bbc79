"""A client of the vrdp service; SI units throughout."""
from .client import Answer, Client, Reading, Simulation, VrdpError

__all__ = ["Answer", "Client", "Reading", "Simulation", "VrdpError"]
