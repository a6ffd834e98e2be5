"""The methods: one frozen dataclass each, holding its parameters, and a table of their names."""

from softshadow.methods.accumulation import Accumulation
from softshadow.methods.auto import Auto
from softshadow.methods.base import Method
from softshadow.methods.convolution import Convolution
from softshadow.methods.counted import Counted
from softshadow.methods.filtered import DeepShadow, Pcf
from softshadow.methods.hard import Hard
from softshadow.methods.layered import Mlsm, Mtsm, Slsm
from softshadow.methods.mvsm import Mvsm
from softshadow.methods.ray_traced import RayTraced
from softshadow.methods.single_sample import SingleSample
from softshadow.methods.ssoc import Ssoc
from softshadow.methods.table import MethodLike, method_names, resolve
from softshadow.methods.wedges import ShadowVolume, Wedges

__all__ = [
    "Accumulation",
    "Auto",
    "Convolution",
    "Counted",
    "DeepShadow",
    "Hard",
    "Method",
    "MethodLike",
    "Mlsm",
    "Mtsm",
    "Mvsm",
    "Pcf",
    "RayTraced",
    "ShadowVolume",
    "SingleSample",
    "Slsm",
    "Ssoc",
    "Wedges",
    "method_names",
    "resolve",
]
