/* Small vectors and matrices, for all that deals with poses. */

#include "numbers.h"

void rotated(const double *R, const double *v, double *result)
{
    for (int a = 0; a < 3; a++)
        result[a] = R[3 * a] * v[0] + R[3 * a + 1] * v[1] + R[3 * a + 2] * v[2];
}

double product(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

void cross(const double *a, const double *b, double *result)
{
    for (int i = 0; i < 3; i++)
        result[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

void rotate(const double *w, const double *R, double *result)
{
    const double square = product(w, w), angle = sqrt(square) + 1e-150, half = sin(angle / 2) / angle;
    const double sine = sin(angle) / angle, versine = 2 * half * half;
    for (int j = 0; j < 3; j++) {
        const double v[3] = {R[j], R[3 + j], R[6 + j]}, along = product(w, v);
        double across[3];
        cross(w, v, across);
        for (int a = 0; a < 3; a++)
            result[3 * a + j] = v[a] + sine * across[a] + versine * (w[a] * along - square * v[a]);
    }
}

Pose joined(const Pose *ab, const Pose *bc)
{
    Pose ac = *ab;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const double *R = ab->R + 3 * i, *S = bc->R + j;
            ac.R[3 * i + j] = R[0] * S[0] + R[1] * S[3] + R[2] * S[6];
            ac.t[i] += R[j] * bc->t[j];
        }
    return ac;
}

Pose inverse_of(const Pose *ab)
{
    Pose ba = {{0}, {0}, 1};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            ba.R[3 * i + j] = ab->R[3 * j + i];
            ba.t[i] -= ab->R[3 * j + i] * ab->t[j];
        }
    return ba;
}

void invert_two(const double *A, double *inverse)
{
    const double det = A[0] * A[3] - A[1] * A[2], result[4] = {A[3] / det, -A[1] / det, -A[2] / det, A[0] / det};
    memcpy(inverse, result, sizeof result);
}

void carry(const double *J, const double *S, double *carried)
{
    const double a = J[0] * S[0] + J[1] * S[1], b = J[0] * S[1] + J[1] * S[2];
    const double c = J[2] * S[0] + J[3] * S[1], d = J[2] * S[1] + J[3] * S[2];
    carried[0] = a * J[0] + b * J[1];
    carried[1] = a * J[2] + b * J[3];
    carried[2] = c * J[2] + d * J[3];
}

double quadratic(const double *W, const double *r)
{
    return (W[0] * r[0] + W[1] * r[1]) * r[0] + (W[1] * r[0] + W[2] * r[1]) * r[1];
}

void invert_symmetric(const double *S, double *W)
{
    const double det = S[0] * S[2] - S[1] * S[1], result[3] = {S[2] / det, -S[1] / det, S[0] / det};
    memcpy(W, result, sizeof result);
}

/* As the compiler knows its number of columns. */
static inline void solve_columns(int n, double *N, double *b, int count, double least)
{
    /* Operations that do not wait for each other come together. */
    for (int j = 0; j < n; j++) {
        const double pivot = N[n * j + j], inverse = 1 / sqrt(pivot > least ? pivot : least);
        N[n * j + j] = inverse;
        for (int i = j + 1; i < n; i++)
            N[n * i + j] *= inverse;
        for (int i = j + 1; i < n; i++)
            for (int k = j + 1; k <= i; k++)
                N[n * i + k] -= N[n * i + j] * N[n * k + j];
    }
    for (int k = 0; k < n; k++) {
        for (int c = 0; c < count; c++)
            b[count * k + c] *= N[n * k + k];
        for (int i = k + 1; i < n; i++)
            for (int c = 0; c < count; c++)
                b[count * i + c] -= N[n * i + k] * b[count * k + c];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int c = 0; c < count; c++)
            b[count * i + c] *= N[n * i + i];
        for (int k = 0; k < i; k++)
            for (int c = 0; c < count; c++)
                b[count * k + c] -= N[n * i + k] * b[count * i + c];
    }
}

void solve_positive(int n, double *N, double *columns, int count, double least)
{
    if (count == 1)
        solve_columns(n, N, columns, 1, least);
    else if (count == 6)
        solve_columns(n, N, columns, 6, least);
    else
        solve_columns(n, N, columns, count, least);
}

double median(double *values, int64_t count)
{
    return (order_statistic(values, count, (count - 1) / 2) + order_statistic(values, count, count / 2)) / 2;
}

/* E. Wilson and M. Hilferty, 1931. */
double chi2_point(double freedom, double z)
{
    const double spread = 2 / (9 * freedom), root = 1 - spread + z * sqrt(spread);
    return freedom * root * root * root;
}
