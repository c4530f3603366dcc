"""The reference's equations: the article's matrix equations (1)-(7) in NumPy, one function each.

Independent of the C kernel on purpose.  Matrices follow the article: node coordinates N and velocities Ndot are 3 x n
(a column per node), C_s, C_b, C_r are the connectivities of strings, bars and bar centres.  Two errata of the article
are mended, see `mass_matrix` and `bar_force_density`.  Beyond the article: point masses, drag, moved nodes (`moved`) and,
with the sign of winding in, its eq. 8 (`actuator`).

Of eq. 1, N'' M + N K = W, the columns of the free nodes are solved for N''; M^-1 is the inverse of their part of M, with
zeros at the fixed nodes, whose columns give the forces of the ground.  N K = S (gamma + eta) C_s - B lambda C_b is used
as it stands here, without K, and eq. 4-7 without the zeros of Z and V: X = [N Ndot], Xdot = [Ndot N''].

Products of small matrices are written A.dot(B), which takes half the time of A @ B.
"""

from __future__ import annotations

import numpy as np

#: Added to squared string lengths, m2: keeps 0/0 out where a slack string's ends meet, and is lost in any other.
TINY = 1e-300


def connectivity(pairs: np.ndarray, n: int) -> np.ndarray:
    """C_s or C_b: a row per member, -1 at its first node and +1 at its second.  pairs: (members, 2)."""
    C = np.zeros((len(pairs), n))
    C[np.arange(len(pairs)), pairs[:, 0]] = -1.0
    C[np.arange(len(pairs)), pairs[:, 1]] = 1.0
    return C


def diagonal(A, B):
    """Diagonal of A^T B: the dot products of the columns."""
    return np.add.reduce(A * B)


def mass_matrix(C_b: np.ndarray, C_r: np.ndarray, J: np.ndarray, m: np.ndarray, m_p: np.ndarray) -> np.ndarray:
    """M = C_b^T J C_b + C_r^T m C_r of eq. 1, kg, plus the point masses m_p (n,) on its diagonal.

    Erratum: J_i = m_i / 12.  The article's m_i l_i^2 / 12 is a moment of inertia, and M must be a mass.
    """
    return (C_b.T * J) @ C_b + (C_r.T * m) @ C_r + np.diag(m_p)


def levers(C_b: np.ndarray, fixed: np.ndarray, m: np.ndarray, m_p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of each bar the moment of inertia over l^2 about its pin, or else its centre of mass (B,), kg, and its free ends' places
    about that point in terms of the bar's vector (B, n).  Free, without point masses: m / 12, C_b / 2.

    In terms of M these are 1 / (C_b M^-1 C_b^T) and C_b M^-1 / (C_b M^-1 C_b^T), bar by bar.
    """
    first, second = (C_b < 0.0).dot(m_p), (C_b > 0.0).dot(m_p)
    x = (0.5 * m + second) / (m + first + second)  # the centre's place along the bar, from the first node
    x = np.where((C_b < 0.0).dot(fixed), 0.0, np.where((C_b > 0.0).dot(fixed), 1.0, x))
    inertia = m / 12.0 + m * (0.5 - x) ** 2 + first * x**2 + second * (1.0 - x) ** 2
    return inertia, (C_b < 0.0) * -x[:, None] + (C_b > 0.0) * (1.0 - x)[:, None]


def string_motion(N, Ndot, C_s):
    """S = N C_s^T (3, S), lengths xi = |s| and their rates s . sdot / xi (the article's remark after eq. 3); of the segments of
    strings where they are routed."""
    S, Sdot = N.dot(C_s.T), Ndot.dot(C_s.T)
    xi = lengths(diagonal(S, S))
    return S, xi, diagonal(S, Sdot) / xi


def lengths(squares):
    """xi = |s| (S,) m from s . s; no less than the root of TINY."""
    return np.sqrt(squares + TINY)


def elastic_tension(elongation, k, curves=()):
    """f_s (S,) N: gamma xi of eq. 2 and eq. 9.  elongation: xi - xi0, m; k (S,): stiffness, 0 where slack, N/m; curves:
    (string, force over elongation) of the strings that are no plain springs, on the pieces of their curves that they use."""
    f = k * elongation
    for j, force in curves:
        f[j] = force(elongation.item(j))
    return f


def damping_tension(elongation_rate, d, curves=()):
    """f_d (S,) N: eta xi of eq. 3, or eq. 10, on taut strings only.  d (S,): coefficients, 0 where slack, N s/m; curves:
    (string, force over rate) of the taut strings whose dampers are not linear."""
    f = d * elongation_rate
    for j, force in curves:
        f[j] = force(elongation_rate.item(j))
    return f


def bar_force_density(B, Bdot, l2, F, J, arms):
    """lambda (B,) N/m of eq. 1: -J l^-2 [Bdot^T Bdot] - l^-2 [B^T F C_b^T] / 2, diagonals only.

    l2 (B,): the squares of the bars' lengths.  J and arms, which stands for C_b / 2: see `levers`; with point masses and
    fixed ends, too, this lambda leaves b . b'' + |b'|^2 = 0 under N'' M = F + B lambda C_b.
    Erratum: F = W - S (gamma + eta) C_s, the force on the nodes; the article has the strings' term with the other sign.
    """
    return -(diagonal(B, F.dot(arms.T)) + J * diagonal(Bdot, Bdot)) / l2
