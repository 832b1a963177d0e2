/* Lenses: pixels to rays and back, and blobs as a camera without lens distortion sees them.

   With r^2 = x^2 + y^2 of normalized coordinates, Brown-Conrady with all of OpenCV's coefficients is

       s = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6),    q = p2 x + p1 y,
       x' = s x + 2 q x + p2 r^2 + s1 r^2 + s2 r^4,    y' = s y + 2 q y + p1 r^2 + s3 r^2 + s4 r^4,

   then the homography of a sensor tilted by tau_x and tau_y. Equidistant is s = a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8) / r
   with a = atan r. Both are used below the radius `reach` alone, where their Jacobian is positive definite. */

#include "numbers.h"

enum {
    SAMPLES = 32,      /* of a fitted outline; centers differ by less than 1e-5 px with 64, and cost 12 us */
    FEW_SAMPLES = 8,   /* of a rough one: 0.001 px, 0.1 px where it is fifteen times as long as wide; 3 us */
    FIT_STEPS = 3,     /* of Gauss-Newton on an ellipse; likewise with 5 */
    NEWTON_STEPS = 100 /* most need 2 or 3; near the end of the domain, where J is singular, a step halves the error */
};

static const double TOLERANCE = 1e-13; /* of the inverse's residual, as a share of the image's size and the place */
static const double CENTER = 1e-12;    /* r^2 below which atan r / r = 1 - r^2 / 3 */

/* Radial scale s and its derivative by r^2. */
static double radial(const Camera *camera, double square, double *slope)
{
    const double *c = camera->c;
    if (camera->lens == EQUIDISTANT) {
        double r = sqrt(square), a = atan(r), a2 = a * a;
        double s = square < CENTER ? 1 - square / 3 : a / r;
        s *= 1 + a2 * (c[0] + a2 * (c[1] + a2 * (c[2] + a2 * c[3])));
        double grown = (1 + a2 * (3 * c[0] + a2 * (5 * c[1] + a2 * (7 * c[2] + a2 * 9 * c[3])))) / (1 + square);
        *slope = square < CENTER ? c[0] - 1. / 3 : (grown - s) / (2 * square);
        return s;
    }
    double above = 1 + square * (c[0] + square * (c[1] + square * c[4]));
    *slope = c[0] + square * (2 * c[1] + square * 3 * c[4]);
    if (camera->count < 8)
        return above;
    double below = 1 / (1 + square * (c[5] + square * (c[6] + square * c[7])));
    above *= below;
    *slope = (*slope - above * (c[5] + square * (2 * c[6] + square * 3 * c[7]))) * below;
    return above;
}

/* The lens before its sensor is tilted, and its derivatives (2, 2): 0 beyond its reach. */
static int bend(const Camera *camera, const double *at, double *bent, double *J)
{
    double x = at[0], y = at[1], square = x * x + y * y, slope;
    if (!(square < camera->reach * camera->reach))
        return 0;
    double s = radial(camera, square, &slope);
    bent[0] = s * x, bent[1] = s * y;
    J[0] = s + 2 * slope * x * x, J[3] = s + 2 * slope * y * y, J[1] = J[2] = 2 * slope * x * y;
    if (camera->lens == BROWN_CONRADY) {
        const double *c = camera->c;
        double p1 = c[2], p2 = c[3], twice = 2 * (p2 * x + p1 * y), cross = 2 * (p1 * x + p2 * y);
        bent[0] += twice * x + p2 * square, bent[1] += twice * y + p1 * square;
        J[0] += 6 * p2 * x + 2 * p1 * y, J[3] += 6 * p1 * y + 2 * p2 * x, J[1] += cross, J[2] += cross;
        if (camera->count >= 12) {
            double sx = 2 * c[8] + 4 * c[9] * square, sy = 2 * c[10] + 4 * c[11] * square;
            bent[0] += square * (c[8] + c[9] * square), bent[1] += square * (c[10] + c[11] * square);
            J[0] += sx * x, J[1] += sx * y, J[2] += sy * x, J[3] += sy * y;
        }
    }
    return 1;
}

/* Homography T of a tilted sensor, as OpenCV's: 0 where it is not tilted. */
static int tilt(const Camera *camera, double *T)
{
    if (camera->lens != BROWN_CONRADY || camera->count < 14 || (camera->c[12] == 0 && camera->c[13] == 0))
        return 0;
    double cx = cos(camera->c[12]), sx = sin(camera->c[12]), cy = cos(camera->c[13]), sy = sin(camera->c[13]);
    double R[9] = {cy, sy * sx, -sy * cx, 0, cx, sx, sy, -cy * sx, cy * cx};
    for (int j = 0; j < 3; j++) {
        T[j] = R[8] * R[j] - R[2] * R[6 + j];
        T[3 + j] = R[8] * R[3 + j] - R[5] * R[6 + j];
        T[6 + j] = R[6 + j];
    }
    return 1;
}

/* Pixel of a ray, and its derivatives (2, 2), by all lenses but sampled ones: 0 beyond its reach. */
static int project(const Camera *camera, const double *ray, double *pixel, double *J)
{
    double d[3] = {ray[0], ray[1], 1}, D[4] = {1, 0, 0, 1}, T[9], p[3];
    if (camera->lens == PINHOLE ? !isfinite(ray[0] + ray[1]) : !bend(camera, ray, d, D))
        return 0;
    if (tilt(camera, T)) {
        rotated(T, d, p);
        if (!(p[2] > 0))
            return 0;
        for (int i = 0; i < 2; i++) {
            const double w = p[2], x = p[i] / w, a = (T[3 * i] - x * T[6]) / w, b = (T[3 * i + 1] - x * T[7]) / w;
            J[2 * i] = a * D[0] + b * D[2], J[2 * i + 1] = a * D[1] + b * D[3];
            d[i] = x;
        }
        memcpy(D, J, sizeof D);
    }
    pixel[0] = camera->fx * d[0] + camera->cx, pixel[1] = camera->fy * d[1] + camera->cy;
    J[0] = camera->fx * D[0], J[1] = camera->fx * D[1], J[2] = camera->fy * D[2], J[3] = camera->fy * D[3];
    return 1;
}

/* Node and weights of cubic interpolation between four of `count` nodes, with the weights' derivatives by the place. */
static int64_t cubic(double place, int64_t count, double *w, double *d)
{
    int64_t first = (int64_t)place - 1;
    first = first > count - 4 ? count - 4 : first;
    first = first < 0 ? 0 : first;
    double t = place - (double)first, a = t, b = t - 1, c = t - 2, e = t - 3;
    w[0] = -b * c * e / 6, w[1] = a * c * e / 2, w[2] = -a * b * e / 2, w[3] = a * b * c / 6;
    d[0] = -(b * c + b * e + c * e) / 6, d[1] = (a * c + a * e + c * e) / 2;
    d[2] = -(a * b + a * e + b * e) / 2, d[3] = (a * b + a * c + b * c) / 6;
    return first;
}

/* Ray of a pixel from a sampled map, and its derivatives (2, 2) by the pixel: 0 outside, and where nodes have no ray. The
   nodes' first and last lines are the image's edges, at -0.5 and width - 0.5. */
static int sampled(const Camera *camera, const double *pixel, double *ray, double *J)
{
    double sx = (double)(camera->columns - 1) / (double)camera->width, px = (pixel[0] + 0.5) * sx;
    double sy = (double)(camera->rows - 1) / (double)camera->height, py = (pixel[1] + 0.5) * sy;
    double wx[4], dx[4], wy[4], dy[4];
    if (camera->columns < 4 || camera->rows < 4 || !(px >= 0 && px <= (double)(camera->columns - 1)) ||
        !(py >= 0 && py <= (double)(camera->rows - 1)))
        return 0;
    int64_t column = cubic(px, camera->columns, wx, dx), row = cubic(py, camera->rows, wy, dy);
    ray[0] = ray[1] = J[0] = J[1] = J[2] = J[3] = 0;
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++) {
            const double *node = camera->map + 2 * ((row + i) * camera->columns + column + j);
            for (int k = 0; k < 2; k++) {
                ray[k] += wy[i] * wx[j] * node[k];
                J[2 * k] += wy[i] * dx[j] * sx * node[k], J[2 * k + 1] += dy[i] * sy * wx[j] * node[k];
            }
        }
    return isfinite(ray[0]) && isfinite(ray[1]);
}

/* Pixel of the nearest of some hundred nodes of a sampled map. */
static void nearest_node(const Camera *camera, const double *ray, double *pixel)
{
    int64_t skip = (camera->columns > camera->rows ? camera->columns : camera->rows) / 16 + 1;
    double least = INFINITY;
    for (int64_t i = 0; i < camera->rows; i += skip)
        for (int64_t j = 0; j < camera->columns; j += skip) {
            const double *node = camera->map + 2 * (i * camera->columns + j);
            double dx = node[0] - ray[0], dy = node[1] - ray[1];
            if (dx * dx + dy * dy < least) {
                least = dx * dx + dy * dy;
                pixel[0] = (double)j * (double)camera->width / (double)(camera->columns - 1) - 0.5;
                pixel[1] = (double)i * (double)camera->height / (double)(camera->rows - 1) - 0.5;
            }
        }
}

/* Inverse of a map by damped Newton steps from `at`, which it replaces, with the derivatives J of the inverse: 0 where there is
   none. Where the map's own are positive definite, a fraction of a step reduces the residual; if it has no value at the start, from
   a place nearer the origin. */
static int invert(const Camera *camera, int (*map)(const Camera *, const double *, double *, double *), const double *target,
                  double tolerance, double *at, double *J)
{
    double least = INFINITY, from[2] = {0, 0}, step[2] = {at[0], at[1]}, value[2], off[2];
    for (int i = 0; i < NEWTON_STEPS; i++) {
        double error = INFINITY;
        if (map(camera, at, value, J)) {
            off[0] = target[0] - value[0], off[1] = target[1] - value[1];
            error = off[0] * off[0] + off[1] * off[1];
        }
        if (error < least) {
            invert_two(J, J);
            if (error <= tolerance * tolerance)
                return 1;
            from[0] = at[0], from[1] = at[1], least = error;
            step[0] = J[0] * off[0] + J[1] * off[1], step[1] = J[2] * off[0] + J[3] * off[1];
        } else
            step[0] /= 2, step[1] /= 2;
        at[0] = from[0] + step[0], at[1] = from[1] + step[1];
    }
    return 0;
}

/* Ray of a pixel, from a guess, with its derivatives (2, 2). */
static int ray_from(const Camera *camera, const double *pixel, double *ray, double *J)
{
    if (camera->lens == SAMPLED)
        return sampled(camera, pixel, ray, J);
    double u = pixel[0] - camera->cx, v = pixel[1] - camera->cy;
    if (camera->lens == PINHOLE) {
        ray[0] = u / camera->fx, ray[1] = v / camera->fy;
        J[0] = 1 / camera->fx, J[1] = J[2] = 0, J[3] = 1 / camera->fy;
        return isfinite(u) && isfinite(v);
    }
    return invert(camera, project, pixel, TOLERANCE * (camera->fx + fabs(u) + fabs(v)), ray, J);
}

/* A ray in the middle, from which others are found. */
static const double MIDDLE[2] = {0, 0};

int lens_ray(const Camera *camera, double x, double y, double *ray)
{
    double J[4], pixel[2] = {x, y};
    memcpy(ray, MIDDLE, sizeof MIDDLE);
    return ray_from(camera, pixel, ray, J);
}

void lens_pixel(const Camera *camera, const double *ray, double *pixel, double *J)
{
    double D[4], at[2] = {NAN, NAN};
    int seen;
    if (camera->lens == SAMPLED) {
        nearest_node(camera, ray, at);
        seen = invert(camera, sampled, ray, 10 * TOLERANCE * (1 + fabs(ray[0]) + fabs(ray[1])), at, D);
    } else
        seen = project(camera, ray, at, D);
    for (int k = 0; k < 2; k++)
        pixel[k] = seen ? at[k] : NAN;
    for (int k = 0; k < 4 && J; k++)
        J[k] = seen ? D[k] : NAN;
}

/* Ellipse with the least weighted squared distance from points near its outline, which stand at even steps of its
   parameter. With center c and symmetric M, which maps the ellipse to the unit circle, the distance is (rho - 1) / |grad rho|
   to first order, with rho = |M (x - c)|, as in the fit to the grey levels. It is that in the image: J (count, 4) are the
   derivatives of the points by its pixels. Writes c and E = M^-2. */
static int fit_ellipse(int count, double (*points)[2], double (*circle)[2], double (*J)[4], const double *weight, double *c, double *E)
{
    static const double ONE[3] = {1, 0, 1};
    double A[4] = {0, 0, 0, 0}, s[3], m[3];
    c[0] = c[1] = 0;
    for (int i = 0; i < count; i++)
        c[0] += points[i][0] / count, c[1] += points[i][1] / count;
    /* The first harmonic of the points gives the axes. */
    for (int i = 0; i < count; i++)
        for (int k = 0; k < 4; k++)
            A[k] += 2 * (points[i][k / 2] - c[k / 2]) * circle[i][k % 2] / count;
    /* M = (A A')^(-1/2); the root of a 2 x 2 matrix S is (S + sqrt(det S) I) / sqrt(trace S + 2 sqrt(det S)). */
    carry(A, ONE, s);
    double det = fabs(A[0] * A[3] - A[1] * A[2]), scale = sqrt(s[0] + s[2] + 2 * det) * det;
    m[0] = (s[2] + det) / scale, m[1] = -s[1] / scale, m[2] = (s[0] + det) / scale;
    for (int step = 0; step < FIT_STEPS; step++) {
        double N[25] = {0}, b[5] = {0};
        for (int i = 0; i < count; i++) {
            double x = points[i][0] - c[0], y = points[i][1] - c[1];
            double u = m[0] * x + m[1] * y, v = m[1] * x + m[2] * y, rho = sqrt(u * u + v * v);
            u /= rho, v /= rho;
            double gx = m[0] * u + m[1] * v, gy = m[1] * u + m[2] * v;
            double px = J[i][0] * gx + J[i][2] * gy, py = J[i][1] * gx + J[i][3] * gy, w = weight[i] / (px * px + py * py);
            double row[5] = {-gx, -gy, u * x, u * y + v * x, v * y};
            for (int j = 0; j < 5; j++) {
                b[j] += w * row[j] * (1 - rho);
                for (int k = 0; k <= j; k++)
                    N[5 * j + k] += w * row[j] * row[k];
            }
        }
        solve_positive(5, N, b, 1, 1e-300);
        c[0] += b[0], c[1] += b[1], m[0] += b[2], m[1] += b[3], m[2] += b[4];
    }
    double inverse[3];
    invert_symmetric(m, inverse);
    double root[4] = {inverse[0], inverse[1], inverse[1], inverse[2]};
    carry(root, ONE, E);
    return isfinite(c[0]) && isfinite(c[1]) && E[0] > 0 && E[0] * E[2] > E[1] * E[1];
}

/* Rays of an outline's points, center + axes (u, v) for (u, v) on a circle, and the ellipse c, E that fits them best, weighted by
   their arc length as in the fit to the grey levels: a distorted ellipse is none. `J` (count, 4): derivatives of the rays. */
static int undo_outline(const Camera *camera, const double *center, const double *axes, int count, double (*circle)[2],
                        double (*points)[2], double (*J)[4], double *c, double *E)
{
    double weight[SAMPLES], middle[4];
    memcpy(c, MIDDLE, sizeof MIDDLE);
    if (!ray_from(camera, center, c, middle))
        return 0;
    for (int i = 0; i < count; i++) {
        const double u = circle[i][0], v = circle[i][1];
        const double dx = axes[0] * u + axes[1] * v, dy = axes[2] * u + axes[3] * v;
        const double pixel[2] = {center[0] + dx, center[1] + dy};
        points[i][0] = c[0] + middle[0] * dx + middle[1] * dy, points[i][1] = c[1] + middle[2] * dx + middle[3] * dy;
        if (!ray_from(camera, pixel, points[i], J[i]))
            return 0;
        weight[i] = hypot(axes[1] * u - axes[0] * v, axes[3] * u - axes[2] * v);
    }
    return fit_ellipse(count, points, circle, J, weight, c, E);
}

void outline_bend(const Camera *camera, const Blob *blob, int count, double *bend)
{
    memset(bend, 0, (size_t)count * sizeof *bend);
    if (camera->lens == PINHOLE)
        return;
    const double cosine = cos(blob->angle), sine = sin(blob->angle), a = blob->semi[0], b = blob->semi[1];
    const double mixed = (a - b) * cosine * sine;
    const double axes[4] = {a * cosine * cosine + b * sine * sine, mixed, mixed, a * sine * sine + b * cosine * cosine};
    double circle[SAMPLES][2], points[SAMPLES][2], J[SAMPLES][4], c[2], E[3], inverse[3];
    for (int i = 0; i < count; i++) {
        const double angle = 2 * acos(-1.) * (i + 0.5) / count;
        circle[i][0] = cos(angle), circle[i][1] = sin(angle);
    }
    if (!undo_outline(camera, blob->center, axes, count, circle, points, J, c, E))
        return;
    invert_symmetric(E, inverse);
    for (int i = 0; i < count; i++) {
        const double x = points[i][0] - c[0], y = points[i][1] - c[1];
        const double gx = inverse[0] * x + inverse[1] * y, gy = inverse[1] * x + inverse[2] * y, rho = sqrt(gx * x + gy * y);
        bend[i] = (rho - 1) * rho / hypot(J[i][0] * gx + J[i][2] * gy, J[i][1] * gx + J[i][3] * gy);
    }
}

static int undo_one(const Camera *camera, int count, double (*circle)[2], Blob *blob)
{
    static const double ONE[3] = {1, 0, 1};
    double cosine = cos(blob->angle), sine = sin(blob->angle), J[4], square[3], points[SAMPLES][2], along[SAMPLES][4];
    /* Half axes as columns. */
    double axes[4] = {cosine * blob->semi[0], -sine * blob->semi[1], sine * blob->semi[0], cosine * blob->semi[1]};
    if (!(blob->semi[1] > 0 && isfinite(blob->semi[0]) && isfinite(blob->angle)))
        return 0;
    memcpy(blob->at, MIDDLE, sizeof MIDDLE);
    if (!ray_from(camera, blob->center, blob->at, J))
        return 0;
    carry(J, blob->covariance, blob->spread);
    if (camera->lens != PINHOLE)
        return undo_outline(camera, blob->center, axes, count, circle, points, along, blob->at, blob->shape);
    carry(axes, ONE, square);
    carry(J, square, blob->shape);
    return 1;
}

void undo_lens(const Camera *camera, Blob *blobs, const int64_t *which, int64_t count)
{
    double circle[SAMPLES][2], coarse[FEW_SAMPLES][2];
    for (int i = 0; i < SAMPLES; i++)
        circle[i][0] = cos(2 * acos(-1.) * i / SAMPLES), circle[i][1] = sin(2 * acos(-1.) * i / SAMPLES);
    for (int i = 0; i < FEW_SAMPLES; i++)
        memcpy(coarse[i], circle[i * (SAMPLES / FEW_SAMPLES)], sizeof coarse[i]);
    for (int64_t i = 0; i < count; i++) {
        Blob *blob = blobs + (which ? which[i] : i);
        int fitted = blob->state == FITTED;
        blob->reached = undo_one(camera, fitted ? SAMPLES : FEW_SAMPLES, fitted ? circle : coarse, blob);
    }
}
