/* What numbers.c offers. Matrices are row by row; symmetric 2 x 2 ones xx, xy, yy. */

#ifndef MARKERGEN_NUMBERS_H
#define MARKERGEN_NUMBERS_H

#include "detector.h"

/* R v, a'b, a x b, and exp([w]x) R by the formula of Rodrigues. */
void rotated(const double *R, const double *v, double *result);
double product(const double *a, const double *b);
void cross(const double *a, const double *b, double *result);
void rotate(const double *w, const double *R, double *result);

/* T_ac of T_ab and T_bc, with the focal length of the first, and T_ba of T_ab. */
Pose joined(const Pose *ab, const Pose *bc);
Pose inverse_of(const Pose *ab);

/* The inverses of a 2 x 2 matrix and of a symmetric one; r'W r and J S J' for symmetric W and S. */
void invert_two(const double *A, double *inverse);
void invert_symmetric(const double *S, double *inverse);
double quadratic(const double *W, const double *r);
void carry(const double *J, const double *S, double *carried);

/* Of values that it puts in another order. */
double median(double *values, int64_t count);

/* The value of chi-squared below which a share of it is, by the normal distribution's point z of that share. */
double chi2_point(double freedom, double z);

#endif
