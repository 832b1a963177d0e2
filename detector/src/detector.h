/* What the files of the detector share. Plain C99 without state: any number of threads may call it.

   Frames: pixel centers at whole coordinates, x right, y down; normalized coordinates (X/z, Y/z) of a camera without lens
   distortion; T_camera_body maps body to camera, X_camera = R X_body + t, in m. Symmetric 2 x 2 matrices are xx, xy, yy. */

#ifndef MARKERGEN_DETECTOR_H
#define MARKERGEN_DETECTOR_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { NO_MEMORY = -1 };

/* ---- library.c ---- */

/* Digest of the sources that the library was built from. */
const char *detector_source(void);

/* ---- numbers.c ---- */

/* Solves N x = b for columns b (n, count), which it replaces, by Cholesky's decomposition of N (n, n), of which the lower triangle
   alone is read, and is replaced. Pivots are `least` or more; without that, -INFINITY, a matrix that is not positive gives nan. */
void solve_positive(int n, double *N, double *columns, int count, double least);

/* ---- image.c ---- */

/* Grey levels, `stride` bytes from one row to the next. `wide`: uint16 instead of uint8. `inverted`: the pixels are read as
   the highest level of their type minus themselves, so that light dots are dark ones. */
typedef struct {
    const uint8_t *rows;
    int64_t height, width, stride;
    int wide, inverted;
} Image;

enum { ROUGH, FITTED, REFUSED };

/* A dark ellipse in an image: the outline of a disk or ring. */
typedef struct {
    double center[2], semi[2], angle; /* px, px with the longer semi-axis first, rad of the longer one from x */
    double covariance[3];             /* of the center, px^2 */
    double light, dark, blur;         /* grey levels outside and inside; standard deviation of the edge, px */
    double hole;                      /* 0 for a disk, 1 for a ring with a hole of half its size, 0.5 where both look alike */
    double other;                     /* its size if it is of the other kind than `hole` says, relative to `semi` */
    double doubt;                     /* how unlike a dot's the edge is, from 0 */
    double side;                      /* of the pixels that it was measured in, px of the image */
    int32_t state;                    /* ROUGH, FITTED to the grey levels, or REFUSED by that fit: then as rough as before */
    int32_t reached;                  /* whether a ray reaches it: only then it has what follows; see undo_lens */
    double at[2], shape[3];           /* center c and E, (x - c)' E^-1 (x - c) = 1 on the outline, normalized */
    double spread[3];                 /* covariance of `at` */
} Blob;

/* Blobs of an image, those most like dots first, of dots of `smallest` px across and more: the pyramid starts at the level
   in which these are 5 px. Returns their number and writes *blobs, to be freed, or returns NO_MEMORY. At most `most` are
   returned. */
int64_t find_blobs(const Image *image, double smallest, int64_t most, Blob **blobs);
void blobs_free(Blob *blobs);

/* How far a blob that the image's border cuts reaches beyond it, px; 0 of a whole one. */
double cut_px(const Image *image, const Blob *blob);
/* Adds to the variance of a blob's center along each axis. */
void less_sure(Blob *blob, double variance);

/* Standard deviation of the grey noise, from differences of neighbors in plain areas of some 32 rows; 0 if there are none. */
double grey_noise(const Image *image);
/* The k-th smallest of `count` values, which it puts in another order; 0 of none. */
double order_statistic(double *values, int64_t count, int64_t k);
/* The same of numbers that are not negative, in their order, with room for four more behind them. */
double ranked(float *values, int64_t count, int64_t k);

/* ---- lens.c ---- */

enum { PINHOLE, BROWN_CONRADY, EQUIDISTANT, SAMPLED };
enum { COEFFICIENTS = 14 };

typedef struct {
    int64_t width, height;
    double fx, fy, cx, cy;
    int lens, count;           /* kind, number of coefficients */
    double c[COEFFICIENTS];    /* in OpenCV's order */
    double reach;              /* largest radius of normalized coordinates on which the lens is one-to-one */
    int64_t columns, rows;     /* of a sampled map */
    const double *map;         /* (rows, columns, 2): normalized coordinates at even steps over the image, from its outer edge
                                  at -0.5 px to the one at width - 0.5, nan where no ray is; at least 4 x 4 */
} Camera;

/* Normalized coordinates of a pixel: 1, or 0 where no ray reaches it. */
int lens_ray(const Camera *camera, double x, double y, double *ray);
/* Pixel of normalized coordinates, with the derivatives (2, 2) by them unless J is NULL; nan beyond the lens's reach. */
void lens_pixel(const Camera *camera, const double *ray, double *pixel, double *J);
/* Distances, px, inward from a blob's ellipse to the outline of which it is the best fit, in the image of a dot through the lens:
   at `count` points, at most 32, in the middles of the sectors of fit.c. */
void outline_bend(const Camera *camera, const Blob *blob, int count, double *bend);
/* Fills in what `reached` stands for of `count` blobs, all or those of `which`. */
void undo_lens(const Camera *camera, Blob *blobs, const int64_t *which, int64_t count);

/* ---- fit.c ---- */

/* Fits blobs, of which `which` (count) are the numbers, to the grey levels, in place, and sets their state. Their lens is
   to be undone again. The camera's lens bends outlines; NULL for none. Returns 0 or NO_MEMORY. */
int fit_blobs(const Image *image, const Camera *camera, Blob *blobs, const int64_t *which, int64_t count);

/* ---- pose.c ---- */

typedef struct {
    double R[9], t[3];
    double focal; /* factor on normalized coordinates, 1 with a known camera */
} Pose;

/* A dot of a body. */
typedef struct {
    double xyz[3];    /* m, in the body: of a flat plate in one plane, for the search */
    double place[3];  /* m, in the body, as measured on the print, for the pose */
    double normal[3]; /* of its plate, in the body */
    double radius;    /* m */
    double print[9];  /* covariance of `place` in the body, m^2 */
    int32_t ring, plate, id, constellation;
    int32_t neighbor; /* the dot of the body whose outline is nearest */
} Dot;

/* A dot with the blob in which it is seen. */
typedef struct {
    int64_t dot, blob;
} Match;

/* Predicted image of a dot: center and shape of its ellipse, image of its center, normalized; cosine of the angle between
   its normal and the way to the camera; whether it is seen from the front, before the camera. */
typedef struct {
    double center[2], shape[3], point[2], depth, facing;
    int seen;
} Outline;

void outline_of(const Dot *dot, const double *place, const Pose *pose, Outline *outline);
/* Derivatives (2, 7) of a dot's image by (w, dt, log focal), multiplied. */
void image_rows(const Dot *dot, const Pose *pose, double factor, double (*J)[7]);

/* Levenberg-Marquardt on weighted distances between measured and predicted centers, from `pose`, which it replaces. seen (m,
   2), weight (m, 3) the inverse covariances, zero for those that do not count. `places`: 1 for `place`, 0 for `xyz`.
   `focal`: standard deviation of the logarithm of the focal length about 1, 0 for none. Returns chi2, INFINITY if dots are
   not seen from the front. */
double refine_pose(const Dot *dots, const Match *matches, int64_t m, const double *seen, const double *weight, int places,
                   double focal, int steps, double tolerance, Pose *pose);

/* The pose with nearly the same image of the flat dots matched: the normal reflected about the line of sight. */
void mirrored_pose(const Dot *dots, const Match *matches, int64_t m, const Pose *pose, Pose *mirrored);

/* Errors of a body's places and of the camera beside those of single dots. */
typedef struct {
    int64_t common;            /* number of errors common to dots, such as the print's scale or a plate's place */
    const double *moved;       /* (dots, 3, common): displacement of each dot by one standard deviation of each, m, in the body */
    const double *alone;       /* (dots, 9): covariance of each place without them, m^2, which Dot.print, by which dots count, is with;
                                  NULL for Dot.print */
    const double *calibration; /* (4 + Camera.count)^2: L, of which L L' is the covariance of fx, fy, cx, cy and the coefficients;
                                  NULL for none */
    int several;               /* whether the body has several plates or constellations: see SHORT_PX */
} Errors;

/* A pose with its uncertainty. Covariances (6, 6) are of (w, dt): R <- exp([w]x) R, t <- t + dt. */
typedef struct {
    Pose pose, other;                           /* `other` looks much the same for dots of one plane */
    double likelihood;                          /* of `other` relative to `pose`, 0 if it is no contender */
    double image[36], print[36], calibration[36], covariance[36]; /* by source, and their sum; `scale` is in them */
    double chi2, scale;                         /* of the residuals; factor on the covariances from image and print */
    int64_t count, freedom;                     /* dots that count, expected value of chi2 */
} Estimate;

/* The most likely pose of matched dots, from a start that is about right, with outliers dropped one by one: they become the
   last ones of `matches`, in this order. Returns the number of dots kept, 0 if no pose sees them from the front, or NO_MEMORY.
   Blobs are to be `reached`. */
int64_t estimate_pose(const Dot *dots, const Blob *blobs, Match *matches, int64_t m, const Camera *camera,
                      const Errors *errors, const Pose *start, Estimate *estimate);

/* ---- tag.c ---- */

/* Square tags of one family: `cells` along a side with the black border, at most 10; codes (count) of the inner cells, row by
   row from the lowest bit, 1 for black. */
typedef struct {
    int64_t cells, count;
    const uint64_t *codes;
} TagFamily;

enum { TAG_READ, TAG_SMALL, TAG_OUTSIDE, TAG_FAINT, TAG_COVERED, TAG_UNCLEAR };

typedef struct {
    int64_t id;           /* row of the codes, -1 if not read */
    int32_t state;        /* TAG_READ, or why not: cells below the least size where the square looks narrowest; less than half in
                             the image; contrast below the noise; border or quiet zone not seen; no code stands out */
    int32_t rotation;     /* the place's corner k shows the tag's corner (k + rotation) % 4 */
    int32_t mirrored;     /* the tag is seen mirrored: its corners in the order 1, 0, 3, 2, then as for `rotation` */
    double corners[4][2]; /* of the black square, px, from its edges where these were found; in the order of the place */
    double cells[2][64];  /* likelihood of each inner cell's darkness if it is light and if it is black; 0 without its border */
} TagReading;

/* Reads the tag whose black square has these corners (4) in the body, top left, top right, bottom right, bottom left, in a
   view from this pose, which is right to half a cell or so. Returns whether it was read. */
int read_tag(const Image *image, const Camera *camera, const Pose *pose, const double (*corners)[3],
             const TagFamily *family, double least_px, TagReading *reading);
/* Logarithm of the likelihood ratio of a code in its place to cells that are black as often as not, from what is seen of it. */
double agreement(const TagFamily *family, const TagReading *reading, int64_t code);

/* ---- label.c ---- */

/* Dots on one plate, of about one size, from pairs of which poses are guessed. */
typedef struct {
    int64_t plate, count;
    const int64_t *dots;   /* (count) their numbers in the layout */
    const double *points;  /* (count, 3) m, in the plate */
    int64_t pair_count;
    const int64_t *pairs;  /* (pair_count, 2) ordered pairs, places in `dots`, by the next one's order */
    const double *ratio;   /* (pair_count) their lateral distances in radii of the first, ascending */
    int64_t neighbor_count;
    const int64_t *neighbors; /* (count, neighbor_count) the dots nearest to each, places in `dots` */
    double sizes;          /* logarithm of the ratio of the largest to the smallest radius */
    int32_t flat;          /* whether all are at one height */
} Constellation;

/* The geometry of a body; members of a family, which differ by their tags alone, share one. */
typedef struct {
    int64_t count, plate_count, constellation_count;
    const Dot *dots;
    const Pose *plates; /* T_body_plate */
    const Constellation *constellations;
    double reach;      /* in radii of a dot: within it another blob can be taken for the dot, and for no other */
    double extent;     /* largest distance of a dot from their middle, m */
    double middle[3];  /* of the dots, m */
    double print;      /* standard deviation of a dot's place, m */
    int32_t flat;      /* whether all dots are in one plane */
    int32_t ringed;    /* whether some are rings */
    const Errors *errors; /* that dots have in common, and the camera's; NULL for none */
} Layout;

/* Which blob each dot of a layout is seen in. */
typedef struct {
    int64_t count;     /* dots that have a blob */
    int64_t *labels;   /* (n) blobs, -1 for none */
    Pose pose;
    double evidence;   /* logarithm of its likelihood ratio to clutter: see evidence_of */
    double chi2;       /* of centers and outlines */
    double sigma, beyond; /* RMS by which centers miss, and the most likely standard deviation beyond their own, px */
    int64_t missing;   /* dots that should be seen and have no blob */
    int64_t absent;    /* these, and those that might be seen */
} Labeling;

typedef struct Scene Scene;

/* ---- verdict.c ---- */

/* What may be wrong, with the unit of its value. */
enum {
    FOCAL_LENGTH, /* logarithm: the camera's is exp(value) times that of its file */
    ASPECT,       /* logarithm of the ratio fy/fx to that of its file */
    DISTORTION,   /* k1, of the distorted radius, beyond that of its file */
    STRETCH_X,    /* share by which the plates are longer along x */
    STRETCH_Y,    /* and along y; not asked of a single plate, where it is the same as the other way along x */
    BEND_X,       /* m that a plate rises toward its ends in x, over its middle */
    BEND_Y,
    SHUTTER,      /* px that the image moves along x from one row to the next */
    MISPLACED,    /* m that a plate is away from its place in the body; it may be turned, too */
    CAMERA_FILE,  /* the first three together, if no one alone explains it: the first's value */
    BENT,         /* m that a plate rises toward its ends in any direction; likewise */
    CAUSES
};
enum { MOST_CAUSES = 16 };

/* A cause with what is left of chi2 with it, its value and its standard deviation, from the residuals. */
typedef struct {
    int32_t kind, plate; /* the plate that is misplaced, else -1 */
    double chi2, value, sigma;
} Cause;

/* Whether image, print and camera are as stated: chi2 of the residuals with all of their errors is below `limit`. */
typedef struct {
    int32_t consistent;
    int32_t count, likely; /* causes, the best first; how many of these explain the residuals about as well as the first */
    double chi2, limit;
    int64_t freedom;
    Cause causes[MOST_CAUSES];
} Verdict;

/* The verdict on an estimate and the matches kept; `plates` are those that the dots are numbered by. 0 or NO_MEMORY. */
int judge(const Dot *dots, const Blob *blobs, const Match *matches, const Camera *camera, const Errors *errors,
          const Pose *plates, int64_t plate_count, const Estimate *estimate, Verdict *verdict);

/* ---- detect.c ---- */

/* A tag on a body: a row of the codes of its family, and the corners of its black square, m, in the body. */
typedef struct {
    int64_t family, code;
    double corners[4][3];
} Tag;

/* A body that is looked for: a layout with dark or light dots, and the tags that tell it from others of the layout. */
typedef struct {
    int64_t layout, tag_count;
    const Tag *tags;
} Member;

typedef struct {
    int64_t layout_count, member_count, family_count;
    const Layout *layouts;
    const Member *members;
    const TagFamily *families;
    int32_t light; /* whether the dots are light */
} Model;

/* Where a body was in the frame before, and with how many dots. */
typedef struct {
    int64_t member, count;
    Pose pose;
} Track;

typedef struct {
    double smallest;  /* diameter of the smallest dots, px */
    int64_t blobs;    /* most that are looked at */
    int64_t copies;   /* most of each body */
    int64_t steps;    /* of the search for each body, before it is cut */
    double deadline;  /* s from now after which nothing more is begun; 0 for none */
    int32_t symmetric; /* whether one of several labelings that are as likely will do */
} Options;

enum {
    FOUND,
    FEW,        /* fewer blobs than dots that a pose takes */
    UNFIT,      /* no labeling fits: `count` dots of the best one, of which `missing` more should be seen */
    UNSURE,     /* the best labeling might be an accident */
    AMBIGUOUS,  /* labels: another labeling of the same dots is about as likely */
    CLAIMED,    /* another body fits the same dots about as well: `rival` */
    MIRRORED,   /* the mirrored layout fits */
    OTHER_TAG,  /* the tag at its place is another one, `tag`, or not as it should be */
    HIDDEN_TAG, /* no tag is read where its tag should be, and others differ by their tags alone */
    CONTRADICTED /* a plate is where, or as, it should not be */
};

enum { TURNS = 12, PLATES = 12, TAG_NONE = -1 };

typedef struct {
    int32_t member, state, cut;
    int32_t tag_state;       /* of TagReading, TAG_NONE without a tag */
    int32_t tag_family;      /* of the tag that was read */
    int64_t rival, tag;      /* number of a member; code of the tag that was read, -1 for none */
    int64_t tag_place;       /* which of the member's tags should be where that one was read */
    double corners[4][2];    /* of that tag, px */
    int64_t turns;           /* of other labelings that are about as likely */
    double turn[TURNS];      /* by which they are turned about the plate's normal, rad */
    int64_t misplaced;       /* plates that are not where or as they should be */
    int64_t plates[PLATES], places[PLATES]; /* these, and the plates in whose places they are, -1 for none */
    double plate_turns[PLATES]; /* by which they are turned there, rad; nan for mirrored ones */
    int64_t count, missing;
    double evidence, margin; /* of the labeling; how much less the next other one has */
    double sigma;            /* RMS by which the places miss, px */
    Pose pose;
    int64_t *dots;           /* (count) of the layout, then `dropped` more that lie farther off than any error explains */
    int64_t *blobs;          /* (count), then those of the dropped ones */
    int64_t dropped;
    double *pixels;          /* (count, 2) images of the dots' own centers, px */
    double H[9];             /* if `plane`, from (x, y) of a flat body, m, to px of an image without lens distortion */
    int32_t plane;
    double bend;             /* without a camera: RMS by which dots miss H because a lens bends it, px; 0 if too little to tell */
    Camera bent;             /* if so, the camera with that lens */
    Estimate estimate;       /* with a camera */
    Verdict verdict;         /* with a camera */
} Finding;

typedef struct {
    int64_t count, blob_count;
    Finding *findings;
    Blob *blobs;
    int64_t tracked; /* whether all are from windows around where they were */
} Findings;

/* Finds the bodies of a model in an image: found ones and those with dots first, then one finding for each other member. With
   tracks, these are looked for where they were; if not all of them are found again for certain, in the whole image. Returns 0 or
   NO_MEMORY. */
int64_t detect_frame(const Model *model, const Camera *camera, int calibrated, const Image *image, const Options *options,
                     const Track *tracks, int64_t track_count, Findings *findings);
/* The same from blobs that were found before, which become the findings' own. */
int64_t label_frame(const Model *model, const Camera *camera, int calibrated, const Image *image, const Options *options,
                    Findings *findings);
void findings_free(Findings *findings);

/* ---- results.c ---- */

/* The image of a dot's own center, px, which the ellipse's center in its blob is not: 1, or 0 beyond the lens's reach. */
int dot_pixel(const Dot *dot, const Blob *blob, const Pose *pose, const Camera *camera, double *pixel);

/* Without a calibrated camera: images of flat dots' own centers (m, 2), px, through the lens by which blobs are `reached`, and the
   homography H from (x, y) of `xyz`, m, to these, by DLT, scaled to H[8] = 1. Returns 0 if no four dots have no three on a line:
   then H is not written; or NO_MEMORY. */
int correct_centers(const Dot *dots, const Blob *blobs, const Match *matches, int64_t m, const Camera *camera, double *corrected,
                    double *H);

/* A camera with another lens in place of its own: Brown and Conrady's with k1 = strength, or an equidistant one with its focal
   length divided by strength. */
void bend_camera(const Camera *camera, int lens, double strength, Camera *bent);

/* Fills in `dropped` and what follows it in a finding with labels; without a pose that sees its dots from the front it is UNFIT.
   Returns 0 or NO_MEMORY. */
int complete_finding(const Layout *layout, const Camera *camera, int calibrated, const Blob *blobs, Finding *finding);

#endif
