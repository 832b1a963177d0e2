/* Labelings: what label.c offers to detect.c. */

#ifndef MARKERGEN_LABEL_H
#define MARKERGEN_LABEL_H

#include "detector.h"

enum { SEEN = 5, LEAST_DOTS = 4, FEW_DOTS = 12, KEPT = 24, GUESSES = 4096, NEIGHBORS = 64, TRIED = 4096 };

/* Guesses from one blob that are followed, and from all with but half of the votes. */
enum { FOLLOWED = 16, LAST_FOLLOWED = 64 };

/* Least evidence: the expected number of accidental finds is below 1e-6. */
static const double SURE = 13.8;

typedef struct {
    double root[3], mean, sigma;         /* symmetric root of the shape, half its trace, standard deviation of its entries: px */
    double area, size, slack;            /* root of the shape's determinant, half its logarithm, tolerance of guesses */
    double clutter, alike;               /* see densities_of; -1: not asked yet, nor its row of `pairs` */
    double broad, log_broad, log_shape;  /* see weigh; -1: not asked yet */
    double ring, disk;                   /* logarithms of the probability of what is seen of its kind, relative to clutter: see weigh */
    int64_t spot; /* its place in the squares */
} Look;

/* The blobs of an image, by squares of `side`, in normalized coordinates. */
struct Scene {
    const Camera *camera;
    int calibrated;
    double px, focal; /* px per unit; focal length that guesses are made with */
    double rings;     /* share of rings among the blobs */
    Blob *blobs;
    int64_t count;
    Look *looks;
    float *seen[SEEN]; /* of each blob: `at` and `root`, px; 0 for those that no ray reaches */
    int64_t room;      /* for as many, and LANES more */
    float *pairs;      /* (count, 2, room): densities_of a blob that another one shows; NULL if there are too many */
    uint8_t *taken;
    int64_t *owner; /* of each blob while labels are given: -1 */
    int64_t columns, rows;
    double low[2], side;
    int32_t *first, *member; /* places of squares, and at each the number of a blob */
    float *spots[3];         /* `at` and `area` of that blob */
};

typedef struct {
    Pose pose;
    double support; /* sum over near dots of how close blobs are to them, from 0 to 1 each */
    int32_t constellation;
    int64_t start;
} Guess;

typedef struct {
    double distance;
    int64_t blob;
} Neighbor;

/* Memory of a search, and how much it did. */
typedef struct {
    Outline *drawn;
    double *numbers, *seen, *weight, *least, *per_dot, *apart, *shape;
    int64_t *indices, *labels, *next, *trial, *chosen;
    Match *matches;
    Guess *guesses;
    int64_t guess_count, replaced, steps;
    Neighbor *neighbors;
    double position[2][3], normal[2][3]; /* both poses of a disk of radius 1 with the outline of the blob that is guessed from */
    double judged; /* evidence of the labeling that `per_dot` is of */
    uint64_t *tried;
    int cut;
} Work;

typedef struct {
    int64_t count;
    Labeling best[KEPT];
    int64_t *memory;
} Pool;

/* Ends a search that takes too long: after so many steps, or when `late` says so. */
typedef struct Budget {
    int64_t steps;
    int (*late)(const struct Budget *);
    double until;
} Budget;

int scene_of(Scene *scene, const Camera *camera, int calibrated, Blob *blobs, int64_t count);
void scene_free(Scene *scene);
void update_blob(Scene *scene, int64_t k);
void scene_focal(Scene *scene, double focal);
int work_for(Work *work, int64_t dots);
void work_free(Work *work);
int pool_for(Pool *pool, int64_t dots);
void search(Scene *scene, const Layout *layout, const Budget *budget, int thorough, Work *work, Pool *pool);
void settle(const Scene *scene, const Layout *layout, Labeling *labeling, double rival, Work *work);
void fit_labeling(const Scene *scene, const Layout *layout, Labeling *labeling, Work *work);
double evidence_of(const Scene *scene, const Layout *layout, Labeling *labeling, Work *work);
void add_rivals(const Scene *scene, const Layout *layout, Work *work, Pool *pool);
int contradict(const Layout *layout, const Labeling *one, const Labeling *other);
const Labeling *best_of(const Pool *pool);
void drop(Pool *pool, int64_t place);
double shorter_px(double px, const double *shape);
int in_plain_view(const Scene *scene, const Dot *dot, const Pose *pose);
void mirror_scene(Scene *scene);
int64_t turns_of(const Layout *layout, const Pool *pool, int64_t chosen, double margin, double *angles);

static inline int64_t square_of(const Scene *scene, const double *at)
{
    int64_t x = (int64_t)((at[0] - scene->low[0]) / scene->side), y = (int64_t)((at[1] - scene->low[1]) / scene->side);
    x = x < 0 ? 0 : x >= scene->columns ? scene->columns - 1 : x;
    y = y < 0 ? 0 : y >= scene->rows ? scene->rows - 1 : y;
    return y * scene->columns + x;
}

/* Squares that a circle about a place meets; 0 if there are none. A blob may have left its square by a little. */
static inline int squares_around(const Scene *scene, const double *at, double far, int64_t *from, int64_t *to)
{
    const double per = 1 / scene->side, more = far * per + 0.02, x = (at[0] - scene->low[0]) * per, y = (at[1] - scene->low[1]) * per;
    const double left = x - more, right = x + more, top = y - more, bottom = y + more;
    if (!(right >= 0 && bottom >= 0 && left < (double)scene->columns && top < (double)scene->rows))
        return 0;
    from[0] = left > 0 ? (int64_t)left : 0;
    from[1] = top > 0 ? (int64_t)top : 0;
    to[0] = right < (double)scene->columns - 1 ? (int64_t)right : scene->columns - 1;
    to[1] = bottom < (double)scene->rows - 1 ? (int64_t)bottom : scene->rows - 1;
    return 1;
}

static inline int64_t lower_bound(const double *values, int64_t count, double value)
{
    int64_t low = 0, high = count;
    while (low < high) {
        const int64_t middle = (low + high) / 2;
        if (values[middle] < value)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

#endif
