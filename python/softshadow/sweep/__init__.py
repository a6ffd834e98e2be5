"""Many cases, measured one after the other or on many machines, in a store that survives a kill.

`grid` makes cases, `sweep` measures them. A store is a folder of Parquet parts, one a case; a case
that has its part is not measured again.
"""

from softshadow.sweep.cases import Case, grid
from softshadow.sweep.running import sweep

__all__ = ["Case", "grid", "sweep"]
