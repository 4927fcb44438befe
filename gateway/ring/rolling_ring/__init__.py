"""The geometrically exact rolling ring: a belt on an elastic sidewall that rolls on a flat road or a drum.

A steadily rolling, pressurised, extensible beam of finite rotation. Its compliant tread is in unilateral contact with
the road, and the load is imposed. The simulator, the forward estimator and the diagnosis solve it; the linear ring that
other estimators invert (`ring_series`) has equations of its own. Derived in docs/explanation/simulator.md.
"""

from gateway.ring.rolling_ring.block_vibration import BlockResponse as BlockResponse
from gateway.ring.rolling_ring.block_vibration import LoadedBelt as LoadedBelt
from gateway.ring.rolling_ring.block_vibration import TreadBlocks as TreadBlocks
from gateway.ring.rolling_ring.block_vibration import block_response as block_response
from gateway.ring.rolling_ring.equilibrium import MIN_NODES as MIN_NODES
from gateway.ring.rolling_ring.equilibrium import RingNumbers as RingNumbers
from gateway.ring.rolling_ring.equilibrium import RingParameters as RingParameters
from gateway.ring.rolling_ring.equilibrium import RingSolution as RingSolution
from gateway.ring.rolling_ring.equilibrium import RingTangent as RingTangent
from gateway.ring.rolling_ring.equilibrium import at_depth as at_depth
from gateway.ring.rolling_ring.equilibrium import loaded_belt as loaded_belt
from gateway.ring.rolling_ring.equilibrium import solve_rolling_ring as solve_rolling_ring
from gateway.ring.rolling_ring.local_changes import PATTERNS as PATTERNS
from gateway.ring.rolling_ring.local_changes import Change as Change
from gateway.ring.rolling_ring.local_changes import Slope as Slope
from gateway.ring.rolling_ring.local_changes import local_response as local_response
from gateway.ring.rolling_ring.newton_solver import RingNotConvergedError as RingNotConvergedError
