"""Series elements with memory: the law `hysteretic`.

The displacements u of the parts are internal variables.  They follow, continuously, a local minimum of

    Pi(u; x) = sum U_j(u_j) + k_s (x - sum u_j)^2 / 2,      T = k_s (x - sum u_j),

x the element's elongation, k_s the string's own stiffness, in series with the parts.  Where the Hessian diag(f'_j) + k_s 11^T
becomes singular the element snaps: the new state is the limit of the overdamped flow c u'_j = T - f_j(u_j), equal c, with stops
at 0 and at the parts' ends, and Pi before less Pi after is lost.  A slack string (T = 0) keeps u at rest under no force.

A *branch* is a family of such minima: each part is on one of its law's pieces or at its stop, at most one of them on a
piece that does not rise.  All parts and the spring k_s then carry one force, which is a smooth function of x.  A branch ends

* where a part reaches the end of its piece: the next branch joins on, without a loss, if it is stable there;
* at a fold, where dx/dp = 0, p the displacement of the falling part: T has a square root there;
* where the string goes slack.

Ties.  Forces within `Piece.tie` of each other are one.  Parts that come to ends of their pieces at one force come there
together, each to its own end.  Where these are extrema the first part (by index) whose fall goes on stably falls and the others
go back; where none does they snap, and the flow starts with the first of them moving on.  Beyond a tie the part whose end has
the nearer force goes, however little nearer: next to that end may lie a branch as short as the root of the difference, and it
is followed.  So the law does not depend on its parameters continuously: where round-off decides whether forces tie, either of
two stable branches may follow, and both are right.

Parts are elements without memory of any kind; each must rise at first and in the end.
"""

from __future__ import annotations

from .branch import Branch
from .flow import NoStableState
from .memory import Memory, memory, start
from .transitions import Event, follow

__all__ = ["Branch", "Event", "Memory", "NoStableState", "follow", "memory", "start"]
