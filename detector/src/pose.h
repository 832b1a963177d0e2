/* What pose.c offers to verdict.c and results.c. */

#ifndef MARKERGEN_POSE_H
#define MARKERGEN_POSE_H

#include "numbers.h"

enum { POSE = 6, CAMERA = 4 + COEFFICIENTS }; /* unknowns of a pose, (w, dt); most parameters of a camera */

/* What every dot may be off by beyond what grey levels and print say, px. */
static const double OUTLIER_PX = 0.05;

/* What poses are estimated from. */
typedef struct {
    const Dot *dots;
    const Blob *blobs;
    const Match *matches;
    int64_t m;
    const Camera *camera;
    const Errors *errors;
} Sight;

/* The image of a matched dot, normalized: derivatives by the pose and by its place in the body, measured less predicted center,
   and covariances: from the grey levels, and from the print; the area of 1 px^2. */
typedef struct {
    Outline drawn;
    double J[2][POSE], M[2][3], residual[2], image[3], print[3], area;
} Row;

/* Fills in all but covariances and area. */
void derive_row(const Dot *dot, const Blob *blob, const Pose *pose, Row *row);
void fill_row(const Sight *s, int64_t i, const Pose *pose, Row *row);
/* M S M' for the covariance S of a place. */
void through_place(const Row *row, const double *S, double *result);
/* The inverse of the covariance from image and print, and of so many px that a dot may be off by beside. */
void weight_of(const Row *row, double px, double *W);

/* The errors that dots have in common: those of their places, then those of the camera. */
int common_count(const Camera *camera, const Errors *errors);
/* Displacement of match i's image by one standard deviation of each, (2, common_count). */
void fill_columns(const Sight *s, int64_t i, const Row *row, double *columns);

/* A sum of squares chi2 of n unknowns: those of a pose, R <- exp([w]x) R, t <- t + dt, then `more` numbers. */
typedef struct Problem {
    int n;
    /* chi2 with J'WJ (n, n), its lower triangle, and J'Wr (n); INFINITY where dots are not seen. */
    double (*equations)(const struct Problem *problem, const Pose *pose, const double *more, double *normal, double *gradient);
    const void *of;
} Problem;

/* Adds r'Wr to chi2, and to the equations those of two rows u and v, all of which have n unknowns. */
static inline double add_rows(int n, const double *u, const double *v, const double *r, const double *W, double *normal,
                              double *gradient)
{
    const double x = W[0] * r[0] + W[1] * r[1], y = W[1] * r[0] + W[2] * r[1];
    for (int p = 0; p < n; p++) {
        const double wu = W[0] * u[p] + W[1] * v[p], wv = W[1] * u[p] + W[2] * v[p];
        gradient[p] += x * u[p] + y * v[p];
        for (int k = 0; k <= p; k++)
            normal[n * p + k] += wu * u[k] + wv * v[k];
    }
    return x * r[0] + y * r[1];
}

/* Steps of Levenberg and Marquardt from a pose and `more`, which it replaces, until chi2 falls by less than `tolerance` of it, or
   no unknown changes by as much (translations by that share of the distance). Returns chi2; `memory`, 3 n^2 + 4 n numbers, begins
   with J'WJ at the end. */
double descend(const Problem *problem, int steps, double tolerance, Pose *pose, double *more, double *memory);

#endif
