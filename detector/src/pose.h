/* What pose.c offers to verdict.c. */

#ifndef MARKERGEN_POSE_H
#define MARKERGEN_POSE_H

#include "detector.h"

enum { POSE = 6, CAMERA = 4 + COEFFICIENTS }; /* unknowns of a pose, (w, dt); most parameters of a camera */

/* What every dot may be off by beyond what grey levels and print say, px. */
static const double OUTLIER_PX = 0.05;

/* R v, a'b, and exp([w]x) R by the formula of Rodrigues. */
void rotated(const double *R, const double *v, double *result);
double product(const double *a, const double *b);
void turn(const double *w, const double *R, double *result);

/* The derivatives of a dot's image, normalized, by the pose, J (2, 6), and by its place in the body, M (2, 3). */
void dot_rows(const Dot *dot, const Pose *pose, double (*J)[POSE], double (*M)[3]);
/* M S M' for the covariance S of a place. */
void through_place(double (*M)[3], const double *S, double *result);
/* Covariance of a dot's center from the grey levels, px^2, on bodies of several plates widened for short axes. */
void pixel_covariance(const Dot *dot, const Blob *blob, const Pose *pose, const Camera *camera, const Errors *errors, double *S);
/* The derivatives (2, 4 + count) of a ray's pixel by fx, fy, cx, cy and the coefficients. */
void camera_rows(const Camera *camera, const double *ray, double *rows);

#endif
