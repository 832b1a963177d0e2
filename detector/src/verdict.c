/* Whether an image agrees with the camera, the print and the body as stated, and what may be wrong.

   The adjustment of a pose is made again with all errors as they are: residuals r = x - f(pose) - A c, with the covariance S
   of the image, of what every dot may be off by, and of the print, and errors c, common to dots or of the camera, of unit
   variance. The minimum of

       chi2 = sum r' S^-1 r + c'c

   by pose and c has the expectation 2 m - 6 if all is as stated. Then parameters of each cause are added, and the causes are
   ordered by what is left of chi2. One view of a plane tells few apart: its tilt and distance stand for many. */

#include "pose.h"

/* chi2 per degree of freedom up to which all is as usual. With a print of 0.1 mm, photographs of others with the right camera
   file came to 0.3 to 2.0 (11 views of flat and nearly flat papers), those with a nominal file without distortion to 3.2 to
   12, with another camera's to 0.9 to 4.7, of papers bent by 1 mm and more to 6.8 to 11; with a focal length wrong by 20 %
   or a print wrong by 3 %, six dots at a tilt of 28 degrees to 8 and 24. */
static const double USUAL = 3;

/* F statistic from which a cause explains something, and up to which another explains as much as the best one. */
static const double TELLING = 12, ALIKE = 6;

/* Share of chi2 that the best cause must leave less than to be a likely one: else several errors, or others, are at work. */
static const double EXPLAINED = 0.5;

enum { ROUNDS = 12, WIDTH = 6 /* most values of a cause */ };
static const double SETTLED = 1e-3; /* share of chi2 by which a step must lower it for another one */

typedef struct {
    int32_t kind, plate;
    int width;
    double value[WIDTH];
} Trial;

typedef struct {
    const Dot *dots;
    const Blob *blobs;
    const Match *matches;
    int64_t m;
    const Camera *camera;
    const Plate *plates;
    double low[2], high[2]; /* of the dots on their plates, m */
    int common;
    double *weight, *columns; /* (m, 3): S^-1, px^-2; (m, 2, common): A, px */
    double *error;            /* (common): c */
    double *memory;           /* normal equations and steps */
} Case;

/* Where a dot is if a cause has a value. */
static void caused_place(const Case *c, const Dot *dot, const Trial *trial, double *place)
{
    const double *v = trial->value;
    memcpy(place, dot->place, 3 * sizeof *place);
    if (trial->kind < STRETCH_X || trial->kind == SHUTTER || (trial->kind == MISPLACED && dot->plate != trial->plate))
        return;
    const Plate *plate = c->plates + dot->plate;
    double from[3];
    for (int a = 0; a < 3; a++)
        from[a] = dot->place[a] - plate->t[a];
    if (trial->kind == MISPLACED) {
        for (int a = 0; a < 3; a++)
            place[a] += v[3 + a] + v[(a + 1) % 3] * from[(a + 2) % 3] - v[(a + 2) % 3] * from[(a + 1) % 3];
        return;
    }
    const int along = trial->kind == STRETCH_Y || trial->kind == BEND_Y, bends = trial->kind >= BEND_X;
    const double at = plate->R[along] * from[0] + plate->R[3 + along] * from[1] + plate->R[6 + along] * from[2];
    const double half = (c->high[along] - c->low[along]) / 2, share = (at - (c->high[along] + c->low[along]) / 2) / half;
    for (int a = 0; a < 3; a++)
        place[a] += bends ? v[0] * share * share * plate->R[3 * a + 2] : v[0] * at * plate->R[3 * a + along];
}

/* Measured less predicted center of a dot, px, without the common errors. The offset from its blob is carried by the lens's
   derivatives, which know the bias of a center where the lens bends the outline. */
static int caused_residual(const Case *c, int64_t i, const Pose *pose, const Trial *trial, double *residual)
{
    const Dot *dot = c->dots + c->matches[i].dot;
    const double *at = c->blobs[c->matches[i].blob].at, *v = trial->value;
    double place[3], pixel[2], D[4], moved[2] = {0, 0};
    Outline o;
    caused_place(c, dot, trial, place);
    outline_of(dot, place, pose, &o);
    lens_pixel(c->camera, o.center, pixel, D);
    const double x = pixel[0] - c->camera->cx, y = pixel[1] - c->camera->cy;
    const double u = x / c->camera->fx, w = y / c->camera->fy;
    if (trial->kind == FOCAL_LENGTH)
        moved[0] = x * expm1(v[0]), moved[1] = y * expm1(v[0]);
    else if (trial->kind == ASPECT)
        moved[1] = y * expm1(v[0]);
    else if (trial->kind == DISTORTION)
        moved[0] = x * v[0] * (u * u + w * w), moved[1] = y * v[0] * (u * u + w * w);
    else if (trial->kind == SHUTTER)
        moved[0] = y * v[0];
    for (int a = 0; a < 2; a++)
        residual[a] = D[2 * a] * (at[0] - o.center[0]) + D[2 * a + 1] * (at[1] - o.center[1]) - moved[a];
    return o.seen && isfinite(residual[0]) && isfinite(residual[1]);
}

/* chi2 with the normal equations of pose, common errors and the cause; INFINITY where dots are not seen. */
static double equations(const Case *c, const Pose *pose, const Trial *trial, const double *error, double *N, double *g)
{
    static const double STEP[CAUSES] = {1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-7, 1e-7, 1e-6, 1e-7};
    const int k = c->common, n = POSE + k + trial->width;
    double *rows = g + n, chi2 = 0;
    memset(N, 0, sizeof *N * (size_t)(n * n));
    memset(g, 0, sizeof *g * (size_t)n);
    for (int p = 0; p < k; p++) {
        chi2 += error[p] * error[p];
        N[(n + 1) * (POSE + p)] = 1;
        g[POSE + p] = -error[p];
    }
    for (int64_t i = 0; i < c->m; i++) {
        Dot dot = c->dots[c->matches[i].dot];
        const double *W = c->weight + 3 * i, *A = c->columns + 2 * k * i;
        double J[2][POSE], M[2][3], D[4], pixel[2], r[2], ray[2], place[3];
        if (!caused_residual(c, i, pose, trial, r))
            return INFINITY;
        caused_place(c, &dot, trial, place);
        memcpy(dot.place, place, sizeof place);
        dot_rows(&dot, pose, J, M);
        for (int a = 0; a < 2; a++)
            ray[a] = c->blobs[c->matches[i].blob].at[a];
        lens_pixel(c->camera, ray, pixel, D);
        for (int a = 0; a < 2; a++)
            for (int p = 0; p < POSE; p++)
                rows[n * a + p] = D[2 * a] * J[0][p] + D[2 * a + 1] * J[1][p];
        for (int p = 0; p < k; p++)
            for (int a = 0; a < 2; a++) {
                rows[n * a + POSE + p] = A[k * a + p];
                r[a] -= A[k * a + p] * error[p];
            }
        for (int p = 0; p < trial->width; p++) {
            double by[2], from[2];
            Trial other = *trial;
            other.value[p] += STEP[trial->kind];
            caused_residual(c, i, pose, trial, from);
            caused_residual(c, i, pose, &other, by);
            for (int a = 0; a < 2; a++)
                rows[n * a + POSE + k + p] = (from[a] - by[a]) / STEP[trial->kind];
        }
        const double x = W[0] * r[0] + W[1] * r[1], y = W[1] * r[0] + W[2] * r[1];
        chi2 += x * r[0] + y * r[1];
        for (int p = 0; p < n; p++) {
            const double u = W[0] * rows[p] + W[1] * rows[n + p], v = W[1] * rows[p] + W[2] * rows[n + p];
            g[p] += x * rows[p] + y * rows[n + p];
            for (int q = 0; q <= p; q++)
                N[n * p + q] += u * rows[q] + v * rows[n + q];
        }
    }
    return chi2;
}

/* Least chi2 with a cause, from the estimate and a value of 0, by steps of Gauss and Newton, halved where they lead up. Its
   value, of a plate the distance, with the standard deviation at unit weight. */
static double adjusted(const Case *c, const Pose *start, Trial trial, double *value, double *sigma)
{
    const int k = c->common, n = POSE + k + trial.width;
    double *N = c->memory, *g = N + n * n, *step = g + 3 * n, *error = c->error, *moved = error + k, best = INFINITY, share = 1;
    Pose pose = *start, next = pose;
    Trial to = trial;
    memset(error, 0, sizeof *error * (size_t)(2 * k));
    *value = *sigma = 0;
    for (int round = 0; round < ROUNDS; round++) {
        const double chi2 = equations(c, &next, &to, moved, N, g);
        const int settled = best < INFINITY && fabs(chi2 - best) <= SETTLED * best;
        if (chi2 < best) {
            best = chi2;
            pose = next;
            trial = to;
            memcpy(error, moved, sizeof *error * (size_t)k);
            memcpy(step, g, sizeof *step * (size_t)n);
            /* The second right side gives the variance along the value. */
            memset(step + n, 0, sizeof *step * (size_t)n);
            const int from = trial.width == WIDTH ? 3 : 0;
            *value = trial.width == WIDTH ? sqrt(product(trial.value + 3, trial.value + 3)) : trial.value[0];
            for (int p = from; p < trial.width; p++)
                step[2 * n - trial.width + p] = trial.width == 1 ? 1 : *value > 0 ? trial.value[p] / *value : 0;
            memcpy(g, step + n, sizeof *g * (size_t)n);
            solve_positive(n, N, step, 2, 1e-300);
            double variance = 0;
            for (int p = 0; p < n; p++)
                variance += g[p] * step[n + p];
            *sigma = sqrt(variance);
            share = 1;
        } else
            share /= 2;
        if (settled || !(best < INFINITY))
            break;
        double w[3];
        for (int a = 0; a < 3; a++) {
            w[a] = share * step[a];
            next.t[a] = pose.t[a] + share * step[3 + a];
        }
        turn(w, pose.R, next.R);
        for (int p = 0; p < k; p++)
            moved[p] = error[p] + share * step[POSE + p];
        for (int p = 0; p < trial.width; p++)
            to.value[p] = trial.value[p] + share * step[POSE + k + p];
    }
    return best;
}

/* The factor L, S = L L', of a covariance that may be singular: columns without variance of their own are zero. */
static void factorize(const double *S, int n, double *L)
{
    memset(L, 0, sizeof *L * (size_t)(n * n));
    for (int j = 0; j < n; j++)
        for (int i = j; i < n; i++) {
            double sum = S[n * i + j];
            for (int p = 0; p < j; p++)
                sum -= L[n * i + p] * L[n * j + p];
            if (i == j)
                L[n * j + j] = sum > 1e-12 * S[n * j + j] ? sqrt(sum) : 0;
            else
                L[n * i + j] = L[n * j + j] > 0 ? sum / L[n * j + j] : 0;
        }
}

/* Fills in weights, columns and the extent of the dots at the estimate. */
static void prepare(Case *c, const Errors *errors, const Pose *pose)
{
    const int width = errors->calibration ? 4 + c->camera->count : 0, shared = (int)errors->common, k = c->common;
    double L[CAMERA * CAMERA], rows[2 * CAMERA];
    if (width)
        factorize(errors->calibration, width, L);
    for (int64_t i = 0; i < c->m; i++) {
        const int64_t number = c->matches[i].dot;
        const Dot *dot = c->dots + number;
        double J[2][POSE], M[2][3], MD[2][3], D[4], pixel[2], S[3], print[3], *W = c->weight + 3 * i, *A = c->columns + 2 * k * i;
        Outline o;
        outline_of(dot, dot->place, pose, &o);
        lens_pixel(c->camera, o.center, pixel, D);
        dot_rows(dot, pose, J, M);
        for (int a = 0; a < 2; a++)
            for (int q = 0; q < 3; q++)
                MD[a][q] = D[2 * a] * M[0][q] + D[2 * a + 1] * M[1][q];
        through_place(MD, errors->alone ? errors->alone + 9 * number : dot->print, print);
        pixel_covariance(dot, c->blobs + c->matches[i].blob, pose, c->camera, errors, S);
        for (int e = 0; e < 3; e++)
            S[e] += print[e] + (e == 1 ? 0 : OUTLIER_PX * OUTLIER_PX);
        const double det = S[0] * S[2] - S[1] * S[1];
        W[0] = S[2] / det, W[1] = -S[1] / det, W[2] = S[0] / det;
        for (int p = 0; p < shared; p++)
            for (int a = 0; a < 2; a++) {
                const double *d = errors->moved + 3 * shared * number + p;
                A[k * a + p] = MD[a][0] * d[0] + MD[a][1] * d[shared] + MD[a][2] * d[2 * shared];
            }
        if (width)
            camera_rows(c->camera, o.point, rows);
        for (int p = 0; p < width; p++)
            for (int a = 0; a < 2; a++) {
                A[k * a + shared + p] = 0;
                for (int q = p; q < width; q++)
                    A[k * a + shared + p] += rows[width * a + q] * L[width * q + p];
            }
        const Plate *plate = c->plates + dot->plate;
        for (int a = 0; a < 2; a++) {
            double at = 0;
            for (int b = 0; b < 3; b++)
                at += plate->R[3 * b + a] * (dot->place[b] - plate->t[b]);
            c->low[a] = i ? fmin(c->low[a], at) : at;
            c->high[a] = i ? fmax(c->high[a], at) : at;
        }
    }
}

/* The 99.9 % point of chi-squared (E. Wilson and M. Hilferty, 1931). */
static double chi2_point(double freedom)
{
    const double spread = 2 / (9 * freedom), root = 1 - spread + 3.0902 * sqrt(spread);
    return freedom * root * root * root;
}

/* Puts a cause in its place by what is left of chi2 for each degree of freedom; the last one falls out when all are taken. */
static void add_cause(Verdict *verdict, const Cause *cause, double left, double *by)
{
    int at = verdict->count < MOST_CAUSES ? verdict->count++ : MOST_CAUSES;
    for (; at > 0 && by[at - 1] > left; at--)
        if (at < MOST_CAUSES) {
            verdict->causes[at] = verdict->causes[at - 1];
            by[at] = by[at - 1];
        }
    if (at < MOST_CAUSES) {
        verdict->causes[at] = *cause;
        by[at] = left;
    }
}

int judge(const Dot *dots, const Blob *blobs, const Match *matches, const Camera *camera, const Errors *errors,
          const Plate *plates, int64_t plate_count, const Estimate *estimate, Verdict *verdict)
{
    const int64_t m = estimate->count;
    const int k = (int)errors->common + (errors->calibration ? 4 + camera->count : 0), n = POSE + k + WIDTH;
    int64_t *seen = calloc((size_t)plate_count + 1, sizeof *seen), plates_seen = 0;
    double *memory = malloc(sizeof *memory * ((size_t)m * (size_t)(3 + 2 * k) + (size_t)(2 * k + n * n + 5 * n)));
    double by[MOST_CAUSES + 1], value, sigma = 0;
    memset(verdict, 0, sizeof *verdict);
    if (!memory || !seen) {
        free(memory);
        free(seen);
        return NO_MEMORY;
    }
    Case c = {dots, blobs, matches, m, camera, plates, {0, 0}, {0, 0}, k, memory, memory + 3 * m, NULL, NULL};
    c.error = c.columns + 2 * k * m;
    c.memory = c.error + 2 * k;
    prepare(&c, errors, &estimate->pose);
    Trial none = {CAUSES, -1, 0, {0}};
    verdict->freedom = 2 * m - POSE;
    verdict->chi2 = adjusted(&c, &estimate->pose, none, &value, &sigma);
    verdict->limit = verdict->freedom > 0 ? fmax(chi2_point((double)verdict->freedom), USUAL * (double)verdict->freedom) : INFINITY;
    verdict->consistent = verdict->chi2 <= verdict->limit;
    for (int64_t i = 0; i < m; i++)
        plates_seen += seen[dots[matches[i].dot].plate]++ == 0;
    const int64_t trials = verdict->consistent ? 0 : MISPLACED + (plates_seen > 1 ? plate_count : 0);
    for (int64_t i = 0; i < trials; i++) {
        Trial trial = {(int32_t)(i < MISPLACED ? i : MISPLACED), (int32_t)(i < MISPLACED ? -1 : i - MISPLACED), 1, {0}};
        if (i >= MISPLACED) {
            trial.width = WIDTH;
            if (seen[trial.plate] < 3)
                continue;
        } else if ((trial.kind == STRETCH_Y && plates_seen == 1) || ((trial.kind == BEND_X || trial.kind == BEND_Y) && plates_seen > 1))
            continue;
        const double freedom = (double)(verdict->freedom - trial.width);
        if (!(freedom > 0))
            continue;
        Cause cause = {trial.kind, trial.plate, 0, 0, 0};
        cause.chi2 = adjusted(&c, &estimate->pose, trial, &cause.value, &sigma);
        const double left = fmax(1, cause.chi2 / freedom);
        cause.sigma = sigma * sqrt(left);
        if ((verdict->chi2 - cause.chi2) / trial.width > TELLING * left)
            add_cause(verdict, &cause, cause.chi2 / freedom, by);
    }
    for (int i = 0; i < verdict->count && verdict->causes[0].chi2 < EXPLAINED * verdict->chi2; i++)
        verdict->likely += by[i] - by[0] <= ALIKE / (double)verdict->freedom * fmax(1, by[0]);
    free(memory);
    free(seen);
    return 0;
}
