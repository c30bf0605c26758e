"""Rotations in scalar loops, compiled, without allocation: for the control kernels, and for many at once."""

import math

from wrenchflow.compiled import kernel


@kernel
def exp_into(rx, ry, rz, out):
    """Rotation matrix of a rotation vector [rad], into `out` (3, 3)."""
    angle = math.sqrt(rx * rx + ry * ry + rz * rz)
    if angle < 1e-8:  # Second order is exact to rounding here.
        s, c = 1.0 - angle * angle / 6.0, 0.5
    else:
        s, c = math.sin(angle) / angle, (1.0 - math.cos(angle)) / (angle * angle)
    out[0, 0] = 1.0 - c * (ry * ry + rz * rz)
    out[0, 1] = c * rx * ry - s * rz
    out[0, 2] = c * rx * rz + s * ry
    out[1, 0] = c * rx * ry + s * rz
    out[1, 1] = 1.0 - c * (rx * rx + rz * rz)
    out[1, 2] = c * ry * rz - s * rx
    out[2, 0] = c * rx * rz - s * ry
    out[2, 1] = c * ry * rz + s * rx
    out[2, 2] = 1.0 - c * (rx * rx + ry * ry)


@kernel
def quat_into(R, out):
    """Unit quaternion (wxyz) of a rotation matrix, by its largest component, into `out` (4,); w is not negative."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    if trace > R[0, 0] and trace > R[1, 1] and trace > R[2, 2]:
        w = math.sqrt(max(0.0, 1.0 + trace)) / 2.0
        out[0] = w
        out[1] = (R[2, 1] - R[1, 2]) / (4.0 * w)
        out[2] = (R[0, 2] - R[2, 0]) / (4.0 * w)
        out[3] = (R[1, 0] - R[0, 1]) / (4.0 * w)
        return
    i = 0
    if R[1, 1] > R[0, 0]:
        i = 1
    if R[2, 2] > R[i, i]:
        i = 2
    j, k = (i + 1) % 3, (i + 2) % 3
    largest = math.sqrt(max(0.0, 1.0 + R[i, i] - R[j, j] - R[k, k])) / 2.0
    sign = 1.0 if R[k, j] >= R[j, k] else -1.0
    out[0] = sign * (R[k, j] - R[j, k]) / (4.0 * largest)
    out[1 + i] = sign * largest
    out[1 + j] = sign * (R[j, i] + R[i, j]) / (4.0 * largest)
    out[1 + k] = sign * (R[k, i] + R[i, k]) / (4.0 * largest)


@kernel
def log_into(R, out):
    """Rotation vector [rad], of length pi at most, of a rotation matrix, into `out` (>= 3,). `out` needs 4 places."""
    quat_into(R, out)
    w, x, y, z = out[0], out[1], out[2], out[3]
    sine = math.sqrt(x * x + y * y + z * z)
    # atan2 keeps its digits at both ends, where arccos of the trace loses half of them.
    scale = 2.0 if sine < 1e-12 else 2.0 * math.atan2(sine, w) / sine
    out[0], out[1], out[2] = scale * x, scale * y, scale * z
    out[3] = 0.0


@kernel
def multiply_into(A, B, out):
    """Set out = A B for (3, 3) matrices; `out` is neither of them."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@kernel
def multiply_transposed_into(A, B, out):
    """Set out = A B^T for (3, 3) matrices; `out` is neither of them."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[j, 0] + A[i, 1] * B[j, 1] + A[i, 2] * B[j, 2]


@kernel
def matrix_into(w, x, y, z, out):
    """Rotation matrix of a quaternion (wxyz), which need not be of unit length, into `out` (3, 3)."""
    s = 2.0 / (w * w + x * x + y * y + z * z)
    out[0, 0] = 1.0 - s * (y * y + z * z)
    out[0, 1] = s * (x * y - w * z)
    out[0, 2] = s * (x * z + w * y)
    out[1, 0] = s * (x * y + w * z)
    out[1, 1] = 1.0 - s * (x * x + z * z)
    out[1, 2] = s * (y * z - w * x)
    out[2, 0] = s * (x * z - w * y)
    out[2, 1] = s * (y * z + w * x)
    out[2, 2] = 1.0 - s * (x * x + y * y)


@kernel
def matrices_of_quats(quats, out):
    """(n, 4) quaternions (wxyz) to (n, 3, 3) rotation matrices."""
    for i in range(quats.shape[0]):
        matrix_into(quats[i, 0], quats[i, 1], quats[i, 2], quats[i, 3], out[i])


@kernel
def quats_of_matrices(matrices, out):
    """(n, 3, 3) rotation matrices to (n, 4) unit quaternions (wxyz)."""
    for i in range(matrices.shape[0]):
        quat_into(matrices[i], out[i])


@kernel
def matrices_of_vectors(vectors, out):
    """(n, 3) rotation vectors [rad] to (n, 3, 3) rotation matrices."""
    for i in range(vectors.shape[0]):
        exp_into(vectors[i, 0], vectors[i, 1], vectors[i, 2], out[i])


@kernel
def vectors_of_matrices(matrices, out):
    """(n, 3, 3) rotation matrices to (n, 4) rows that begin with the rotation vector [rad]."""
    for i in range(matrices.shape[0]):
        log_into(matrices[i], out[i])
