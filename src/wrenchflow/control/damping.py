"""Damping from task inertia, by double diagonalisation, and the map that keeps nullspace torque out of the task.

Translation and rotation are designed apart, each with the inertia that the hand feels in it. With Lambda = W W^T and
C = W^-1 K W^-T, double diagonalisation's D = 2 Q diag(zeta w) Q^T is 2 zeta W sqrt(C) W^T: every mode is damped by the
same ratio. A joint design of all six would couple a velocity to a moment, and make a peg that slides at 5 mm/s feel
60 mN.m, as much as the rim of a hole makes: what is felt would no longer be contact.

Source: Albu-Schaeffer, Ott, Frese, Hirzinger, *Cartesian Impedance Control of Redundant Robots: Recent Results with the
DLR-Light-Weight-Arms* (2003).
"""

import math

import numpy as np

from wrenchflow.compiled import kernel

_REGULARISATION = 1e-6  # On J M^-1 J^T, so that a singular pose gives a large inertia and no division by zero.


@kernel
def cholesky(A, L):
    """Set L to the lower triangle with A = L L^T; what is not quite positive is taken as a little more than zero."""
    n = A.shape[0]
    for i in range(n):
        for j in range(i + 1):
            s = A[i, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            if i == j:
                L[i, i] = math.sqrt(max(s, 1e-12))
            else:
                L[i, j] = s / L[j, j]
                L[j, i] = 0.0


@kernel
def solve_lower(L, B):
    """Set B = L^-1 B, in place."""
    for c in range(B.shape[1]):
        for i in range(L.shape[0]):
            s = B[i, c]
            for k in range(i):
                s -= L[i, k] * B[k, c]
            B[i, c] = s / L[i, i]


@kernel
def eigen_symmetric(A, U):
    """Make A diagonal in place, and the columns of U its eigenvectors, by cyclic Jacobi rotations."""
    n = A.shape[0]
    for i in range(n):
        for j in range(n):
            U[i, j] = 1.0 if i == j else 0.0
    for _ in range(12):
        off, on = 0.0, 0.0
        for i in range(n):
            on += A[i, i] * A[i, i]
            for j in range(i):
                off += A[i, j] * A[i, j]
        if off <= 1e-24 * on:
            return
        for p in range(n - 1):
            for q in range(p + 1, n):
                if A[p, q] == 0.0:
                    continue
                theta = (A[q, q] - A[p, p]) / (2.0 * A[p, q])
                t = (1.0 if theta >= 0.0 else -1.0) / (abs(theta) + math.sqrt(theta * theta + 1.0))
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for k in range(n):
                    akp, akq = A[k, p], A[k, q]
                    A[k, p], A[k, q] = c * akp - s * akq, s * akp + c * akq
                for k in range(n):
                    apk, aqk = A[p, k], A[q, k]
                    A[p, k], A[q, k] = c * apk - s * aqk, s * apk + c * aqk
                    ukp, ukq = U[k, p], U[k, q]
                    U[k, p], U[k, q] = c * ukp - s * ukq, s * ukp + c * ukq


@kernel
def _design_block(mobility, first, K, damping_ratio, D, inertia):
    """Damping and inertia of three of the six directions, from `first` on, into their blocks; zero beside them."""
    A, L, W = np.empty((3, 3)), np.zeros((3, 3)), np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            A[i, j] = mobility[first + i, first + j]
            W[i, j] = 1.0 if i == j else 0.0
    cholesky(A, L)
    solve_lower(L, W)  # W holds L^-1; Lambda = L^-T L^-1, so L^-T is a square root of it and C = L^T K L.
    C, U, G = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            s = 0.0
            for k in range(3):
                for m in range(3):
                    s += L[k, i] * K[k, m] * L[m, j]
            C[i, j] = s
    eigen_symmetric(C, U)
    for i in range(3):
        for j in range(3):
            G[i, j] = W[0, i] * U[0, j] + W[1, i] * U[1, j] + W[2, i] * U[2, j]
    for i in range(3):
        for j in range(3):
            s = 0.0
            for k in range(3):
                s += G[i, k] * math.sqrt(max(C[k, k], 0.0)) * G[j, k]
            D[first + i, first + j] = 2.0 * damping_ratio * s
            D[first + i, (first + 3) % 6 + j] = 0.0
            inertia[first + i, first + j] = W[0, i] * W[0, j] + W[1, i] * W[1, j] + W[2, i] * W[2, j]
            inertia[first + i, (first + 3) % 6 + j] = 0.0


@kernel
def design_damping(J, M, K_lin, K_rot, damping_ratio, D, P, inertia):
    """Design task-space damping and the nullspace map for the present pose.

    Args:
        J: Jacobian of the TCP, world-aligned. Shape (6, n).
        M: Joint inertia [kg m^2]. Shape (n, n).
        K_lin: Translational stiffness [N/m]. Shape (3, 3).
        K_rot: Rotational stiffness [N.m/rad]. Shape (3, 3).
        damping_ratio: Of every mode.
        D: Out: damping [N.s/m, N.m.s/rad]. Shape (6, 6).
        P: Out: Lambda J M^-1, with the inertia of all six directions. Shape (6, n).
        inertia: Out: task inertia, translation and rotation apart [kg, kg m^2]. Shape (6, 6).
    """
    n = J.shape[1]
    L_M, Y = np.zeros((n, n)), np.empty((n, 6))
    cholesky(M, L_M)
    for i in range(n):
        for a in range(6):
            Y[i, a] = J[a, i]
    solve_lower(L_M, Y)  # Y = L_M^-1 J^T, so J M^-1 J^T = Y^T Y
    mobility = np.empty((6, 6))
    for a in range(6):
        for b in range(a + 1):
            s = _REGULARISATION if a == b else 0.0
            for i in range(n):
                s += Y[i, a] * Y[i, b]
            mobility[a, b] = s
            mobility[b, a] = s
    _design_block(mobility, 0, K_lin, damping_ratio, D, inertia)
    _design_block(mobility, 3, K_rot, damping_ratio, D, inertia)
    # P^T = M^-1 J^T Lambda: two triangular solves on each side.
    L = np.zeros((6, 6))
    cholesky(mobility, L)
    for a in range(6):
        for i in range(n - 1, -1, -1):
            s = Y[i, a]
            for k in range(i + 1, n):
                s -= L_M[k, i] * Y[k, a]
            Y[i, a] = s / L_M[i, i]
    for i in range(n):
        for a in range(6):
            s = Y[i, a]
            for b in range(a):
                s -= L[a, b] * P[b, i]
            P[a, i] = s / L[a, a]
        for a in range(5, -1, -1):
            s = P[a, i]
            for b in range(a + 1, 6):
                s -= L[b, a] * P[b, i]
            P[a, i] = s / L[a, a]
