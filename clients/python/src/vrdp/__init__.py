"""A client of the vrdp service; SI units throughout."""
from .client import Answer, Client, Simulation, VrdpError

__all__ = ["Answer", "Client", "Simulation", "VrdpError"]
