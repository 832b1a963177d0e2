/* From labels to results: the pose with its uncertainty, the dots that are no outliers, and where their centers are. */

#include "pose.h"

/* ---- without a camera: homographies of flat dots ---- */

static void normalization(const double *points, int64_t m, double *center, double *scale)
{
    double square = 0;
    center[0] = center[1] = 0;
    for (int64_t i = 0; i < 2 * m; i++)
        center[i % 2] += points[i] / (double)m;
    for (int64_t i = 0; i < 2 * m; i++)
        square += (points[i] - center[i % 2]) * (points[i] - center[i % 2]) / (double)m;
    *scale = sqrt(2 / square);
}

/* Whether some four of the points have no three on a line: no line has all of them but one. */
static int in_general_position(const double *points, int64_t m)
{
    int general = m >= 4;
    for (int64_t left_out = 0; left_out < m && general; left_out++) {
        double sum[5] = {0};
        for (int64_t i = 0; i < m; i++) {
            const double u = points[2 * i] - points[0], v = points[2 * i + 1] - points[1], terms[5] = {u, v, u * u, u * v, v * v};
            for (int k = 0; k < 5 && i != left_out; k++)
                sum[k] += terms[k] / (double)(m - 1);
        }
        const double xx = sum[2] - sum[0] * sum[0], xy = sum[3] - sum[0] * sum[1], yy = sum[4] - sum[1] * sum[1];
        general = xx * yy - xy * xy > 1e-12 * (xx + yy) * (xx + yy);
    }
    return general;
}

/* Normalized DLT (R. Hartley, 1997): h is the eigenvector of the smallest eigenvalue of A'A, by inverse iteration, of which
   eight steps leave the others' share, which shrinks by the ratio of the eigenvalues each time, below rounding. */
static void solve_homography(const double *from, const double *to, int64_t m, double *H)
{
    static const double ONE[3] = {1, 0, 1};
    double c[2], d[2], in, out, N[81] = {0}, none[9] = {0}, L[81], h[9] = {1, 0.1, 0.2, 0.3, 1, 0.4, 0.5, 0.6, 1};
    normalization(from, m, c, &in);
    normalization(to, m, d, &out);
    for (int64_t i = 0; i < m; i++) {
        const double x = (from[2 * i] - c[0]) * in, y = (from[2 * i + 1] - c[1]) * in;
        const double u = (to[2 * i] - d[0]) * out, v = (to[2 * i + 1] - d[1]) * out;
        const double rows[2][9] = {{x, y, 1, 0, 0, 0, -u * x, -u * y, -u}, {0, 0, 0, x, y, 1, -v * x, -v * y, -v}};
        add_rows(9, rows[0], rows[1], (double[2]){0, 0}, ONE, N, none);
    }
    for (int p = 0; p < 9; p++)
        N[10 * p] += 1e-13 * (double)m;
    for (int step = 0; step < 8; step++) {
        double norm = 0;
        memcpy(L, N, sizeof L);
        solve_positive(9, L, h, 1, 1e-300);
        for (int p = 0; p < 9; p++)
            norm += h[p] * h[p];
        for (int p = 0; p < 9; p++)
            h[p] /= sqrt(norm);
    }
    for (int r = 0; r < 3; r++) {
        h[3 * r] *= in;
        h[3 * r + 1] *= in;
        h[3 * r + 2] -= h[3 * r] * c[0] + h[3 * r + 1] * c[1];
    }
    for (int p = 0; p < 9; p++)
        H[p] = (p < 6 ? h[p] / out + d[p / 3] * h[6 + p % 3] : h[p]) / h[8];
}

int correct_centers(const Dot *dots, const Blob *blobs, const Match *matches, int64_t m, const Camera *camera, double *corrected,
                    double *H)
{
    enum { ROUNDS = 2 }; /* offsets of up to a pixel are known to 3e-3 px after one, and to 4e-5 px after two */
    double *points = malloc((size_t)(2 * m + 1) * sizeof *points);
    if (!points)
        return NO_MEMORY;
    for (int64_t i = 0; i < m; i++) {
        memcpy(points + 2 * i, dots[matches[i].dot].xyz, 2 * sizeof *points);
        memcpy(corrected + 2 * i, blobs[matches[i].blob].at, 2 * sizeof *corrected);
    }
    const int good = in_general_position(points, m);
    if (good)
        solve_homography(points, corrected, m, H);
    for (int round = 0; round < ROUNDS && good; round++) {
        /* The dual conic is D = r^2 (h1 h1' + h2 h2') - p p', with p = H (X, Y, 1). */
        for (int64_t i = 0; i < m; i++) {
            const double r = dots[matches[i].dot].radius, place[3] = {points[2 * i], points[2 * i + 1], 1};
            double p[3];
            rotated(H, place, p);
            const double last = p[2] * p[2] - r * r * (H[6] * H[6] + H[7] * H[7]);
            for (int a = 0; a < 2; a++) {
                const double center = (p[a] * p[2] - r * r * (H[3 * a] * H[6] + H[3 * a + 1] * H[7])) / last;
                corrected[2 * i + a] = blobs[matches[i].blob].at[a] - (center - p[a] / p[2]);
            }
        }
        solve_homography(points, corrected, m, H);
    }
    for (int64_t i = 0; i < m; i++) {
        double pixel[2];
        lens_pixel(camera, corrected + 2 * i, pixel, NULL);
        memcpy(corrected + 2 * i, isfinite(pixel[0]) ? pixel : blobs[matches[i].blob].center, sizeof pixel);
    }
    if (good)
        solve_homography(points, corrected, m, H);
    free(points);
    return good;
}

void bend_camera(const Camera *camera, int lens, double strength, Camera *bent)
{
    const int brown = lens == BROWN_CONRADY;
    *bent = *camera;
    bent->lens = lens;
    bent->count = 1;
    bent->c[0] = brown ? strength : 0;
    bent->fx /= brown ? 1 : strength;
    bent->fy /= brown ? 1 : strength;
    bent->reach = brown && strength < 0 ? sqrt(-1 / (3 * strength)) : 1e6;
}

/* Mean square, px^2, by which a finding's flat dots miss a homography through a lens; INFINITY where it has no ray. `points` (m, 4). */
static double misfit_through(const Dot *dots, const Blob *blobs, const Finding *finding, const Camera *camera, double *points)
{
    const int64_t m = finding->count;
    double H[9], p[3], pixel[2], square = 0, *rays = points + 2 * m;
    for (int64_t i = 0; i < m; i++) {
        const double *center = blobs[finding->blobs[i]].center;
        memcpy(points + 2 * i, dots[finding->dots[i]].xyz, 2 * sizeof *points);
        if (!lens_ray(camera, center[0], center[1], rays + 2 * i))
            return INFINITY;
    }
    solve_homography(points, rays, m, H);
    for (int64_t i = 0; i < m; i++) {
        rotated(H, (double[3]){points[2 * i], points[2 * i + 1], 1}, p);
        lens_pixel(camera, (double[2]){p[0] / p[2], p[1] / p[2]}, pixel, NULL);
        for (int a = 0; a < 2; a++)
            square += pow(pixel[a] - blobs[finding->blobs[i]].center[a], 2) / (double)m;
    }
    return square < INFINITY ? square : INFINITY;
}

/* Lenses, their strengths that are looked for, and steps of golden section, which leave 2e-4 of these. */
static const struct {
    int lens;
    double weakest, strongest;
} BENDS[] = {{BROWN_CONRADY, -1.5, 1.5}, {EQUIDISTANT, 0.2, 3}};
enum { LENSES = sizeof BENDS / sizeof *BENDS, SECTIONS = 18 };
/* Dots that tell a lens from a homography, mean square at which it matters, and its share that the lens must leave less than. */
enum { WHOLE = 16 };
static const double BENT_PX2 = 0.1, STRAIGHTENED = 0.5;

/* RMS, px, by which a finding's flat dots miss a homography if a lens explains it, with the camera that has this lens; 0 if they are
   too few, or miss it by as little as without. */
static double straighten(const Layout *layout, const Blob *blobs, const Finding *finding, const Camera *camera, Camera *bent)
{
    static const double GOLDEN = 0.6180339887498949;
    double plain = 0, least = INFINITY;
    Camera tried;
    double *memory = finding->count < WHOLE || !layout->flat ? NULL : malloc((size_t)(4 * finding->count) * sizeof *memory);
    if (memory)
        plain = misfit_through(layout->dots, blobs, finding, camera, memory);
    for (int k = 0; k < LENSES && plain > BENT_PX2; k++) {
        double ends[2] = {BENDS[k].weakest, BENDS[k].strongest}, inner[2] = {ends[1], ends[0]}, square[2];
        for (int step = -2; step < SECTIONS; step++) {
            const int a = step < 0 ? -1 - step : square[0] < square[1]; /* the end that is left out */
            if (step >= 0) {
                ends[a] = inner[a];
                inner[a] = inner[1 - a];
                square[a] = square[1 - a];
            }
            inner[1 - a] = ends[a] + GOLDEN * (ends[1 - a] - ends[a]);
            bend_camera(camera, BENDS[k].lens, inner[1 - a], &tried);
            square[1 - a] = misfit_through(layout->dots, blobs, finding, &tried, memory);
        }
        for (int a = 0; a < 2; a++)
            if (square[a] < least) {
                least = square[a];
                bend_camera(camera, BENDS[k].lens, inner[a], bent);
            }
    }
    free(memory);
    return least < STRAIGHTENED * plain ? sqrt(plain) : 0;
}

/* ---- with a camera ---- */

int dot_pixel(const Dot *dot, const Blob *blob, const Pose *pose, const Camera *camera, double *pixel)
{
    Outline drawn;
    double ray[2];
    outline_of(dot, dot->place, pose, &drawn);
    for (int a = 0; a < 2; a++)
        ray[a] = blob->at[a] - (drawn.center[a] - drawn.point[a]);
    lens_pixel(camera, ray, pixel, NULL);
    return isfinite(pixel[0]) && isfinite(pixel[1]);
}

/* The homography of the plane through a dot, from (x, y) in the body to px of an image without lens distortion: there,
   z = (n'X - n_x x - n_y y) / n_z. Returns 0 if it is along z. */
static int plane_homography(const Dot *dot, const Pose *pose, const Camera *camera, double *H)
{
    const double *n = dot->normal, along[3] = {-n[0] / n[2], -n[1] / n[2], product(n, dot->xyz) / n[2]};
    for (int k = 0; k < 3; k++) {
        double column[3];
        for (int a = 0; a < 3; a++)
            column[a] = (k < 2 ? pose->R[3 * a + k] : pose->t[a]) + along[k] * pose->R[3 * a + 2];
        H[k] = camera->fx * column[0] + camera->cx * column[2];
        H[3 + k] = camera->fy * column[1] + camera->cy * column[2];
        H[6 + k] = column[2];
    }
    for (int p = 0; p < 9; p++)
        H[p] /= p < 8 ? H[8] : 1;
    H[8] = 1;
    return n[2] != 0;
}

static int by_dot(const void *a, const void *b)
{
    const int64_t x = ((const Match *)a)->dot, y = ((const Match *)b)->dot;
    return (x > y) - (x < y);
}

int complete_finding(const Layout *layout, const Camera *camera, int calibrated, const Blob *blobs, Finding *finding)
{
    static const Errors NONE = {0, NULL, NULL, NULL, 0};
    const Errors *errors = layout->errors ? layout->errors : &NONE;
    const Dot *dots = layout->dots;
    const int64_t m = finding->count;
    int64_t kept = m, status = 0;
    Match *matches = malloc((size_t)(m + 1) * sizeof *matches);
    finding->pixels = malloc((size_t)(2 * m + 1) * sizeof *finding->pixels);
    if (!matches || !finding->pixels)
        kept = NO_MEMORY;
    for (int64_t i = 0; i < m && kept > 0; i++)
        matches[i] = (Match){finding->dots[i], finding->blobs[i]};
    if (calibrated && kept > 0)
        kept = estimate_pose(dots, blobs, matches, m, camera, errors, &finding->pose, &finding->estimate);
    if (kept > 0) {
        qsort(matches, (size_t)kept, sizeof *matches, by_dot);
        for (int64_t i = 0; i < m; i++) {
            finding->dots[i] = matches[i].dot;
            finding->blobs[i] = matches[i].blob;
        }
        finding->count = kept;
        finding->dropped = m - kept;
    } else if (kept == 0 && finding->state == FOUND) {
        finding->state = UNFIT;
        finding->count = 0;
    }
    if (kept > 0 && calibrated) {
        const Pose *pose = &finding->estimate.pose;
        for (int64_t i = 0; i < kept; i++)
            if (!dot_pixel(dots + matches[i].dot, blobs + matches[i].blob, pose, camera, finding->pixels + 2 * i))
                memcpy(finding->pixels + 2 * i, blobs[matches[i].blob].center, 2 * sizeof *finding->pixels);
        finding->plane = layout->flat && plane_homography(dots, pose, camera, finding->H);
        status = judge(dots, blobs, matches, camera, errors, layout->plates, layout->plate_count, &finding->estimate,
                       &finding->verdict);
    } else if (kept > 0) {
        Camera plain = *camera;
        plain.lens = PINHOLE;
        status = correct_centers(dots, blobs, matches, kept, camera, finding->pixels, finding->H);
        finding->plane = status > 0;
        finding->bend = straighten(layout, blobs, finding, &plain, &finding->bent);
    }
    free(matches);
    return kept < 0 || status < 0 ? NO_MEMORY : 0;
}
