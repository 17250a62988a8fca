"""OpenCL device of this process: selected and opened on first use, never at import."""

from pipeline.compute.choice import Candidate, candidates, report
from pipeline.compute.opencl import Device, DeviceArray, Kernel, Launch, device

__all__ = ["Candidate", "Device", "DeviceArray", "Kernel", "Launch", "candidates", "device", "report"]
