/* What is behind blurred outlines, compiled; see kernel.c. */

#include <math.h>
#include <stdint.h>

/* ------------------------------------------------------------------------------------------------------------------
   solve_blurred: semi-axes, blur and depth of blurred disks or rings (twin: blurred_outlines.py, _solved).

   longer, shorter, slope, ring, least, most (k); quarter (QUARTER); table (4, TABLE): size, seen, depth, middle of rings;
   settings: least and largest share, least depth, most inward. semi (2, k), blur, depth, level (k). */

enum { QUARTER = 12, TABLE = 14 };

static double larger(double a, double b) { return a > b ? a : b; }
static double smaller(double a, double b) { return a < b ? a : b; }

static double normal_below(double x) { return erfc(-x * 0.70710678118654752440) / 2; }

/* Its inverse for probabilities from 0.02 to 0.98, by Halley's method. */
static double quantile(double p)
{
    double x = (p - 0.5) * 2.5066282746310005024;
    for (int i = 0; i < 5; i++) {
        const double step = (normal_below(x) - p) * 2.5066282746310005024 * exp(x * x / 2);
        x -= step / (1 + x * step / 2);
    }
    return x;
}

static double interpolated(double x, const double *from, const double *to)
{
    int i = 0;
    if (!(x > from[0]))
        return to[0];
    if (x >= from[TABLE - 1])
        return to[TABLE - 1];
    while (x >= from[i + 1])
        i++;
    return to[i] + (x - from[i]) * ((to[i + 1] - to[i]) / (from[i + 1] - from[i]));
}

/* By how much the semi-axes of the ellipse through the half-level are too short: _moved_inward. */
static void moved_inward(double a, double b, double s, const double *quarter, double most, double *moved)
{
    double aa = 0, ab = 0, bb = 0, x = 0, y = 0;
    for (int i = 0; i < QUARTER; i++) {
        const double along = b * quarter[i], across = a * (1 - quarter[i]), square = b * along + a * across;
        const double root = sqrt(square), inward = s * smaller(s * a * b / (2 * square * root), most);
        aa += along * along / square;
        ab += along * across / square;
        bb += across * across / square;
        x += along * inward / root;
        y += across * inward / root;
    }
    moved[0] = (bb * x - ab * y) / (aa * bb - ab * ab);
    moved[1] = (aa * y - ab * x) / (aa * bb - ab * ab);
}

void solve_blurred(int64_t k, int64_t steps, const double *longer, const double *shorter, const double *slope,
                   const uint8_t *ring, const double *least, const double *most, const double *quarter,
                   const double *table, const double *settings, double *semi, double *blur, double *depth, double *level)
{
    const double *sizes = table, *seen = table + TABLE, *depths = table + 2 * TABLE, *middles = table + 3 * TABLE;
    for (int64_t i = 0; i < k; i++) {
        const double a = longer[i], b = shorter[i], mean = a * b / sqrt((a * a + b * b) / 2);
        double lost = 0, outside = 0, s = 1, moved[2];
        depth[i] = 1;
        level[i] = 0;
        for (int64_t step = 0; step < steps; step++) {
            const double share = smaller(larger(slope[i] * depth[i] + lost, settings[0]), settings[1]);
            s = smaller(larger(1 / quantile((1 + share) / 2), least[i]), most[i]);
            if (!ring[i]) {
                double dark = 0, whole = 0;
                for (int j = 0; j < QUARTER; j++) {
                    const double square = a * a * quarter[j] + b * b * (1 - quarter[j]);
                    dark -= expm1(square * (-0.5 / (s * s))) / square;
                    whole += 1 / square;
                }
                depth[i] = larger(dark / whole, settings[2]);
                outside = -s * quantile(depth[i] / 2);
                continue;
            }
            const double at = mean / s, size = at < seen[TABLE - 1] ? interpolated(at, seen, sizes) : at;
            level[i] = interpolated(size, sizes, middles);
            depth[i] = larger(interpolated(size, sizes, depths), settings[2]);
            outside = mean - s * (size - 0.5 / size);
            const double inner = (1 - outside) / s, outer = (-1 - outside) / s, width = size / 2;
            lost = 2 * normal_below(1 / s) - 1 - normal_below(inner) + normal_below(outer) + normal_below(inner - width)
                   - normal_below(outer - width);
        }
        moved_inward(a, b, s, quarter, settings[3], moved);
        semi[i] = a - outside + moved[0];
        semi[k + i] = b - outside + moved[1];
        blur[i] = s;
    }
}

/* ------------------------------------------------------------------------------------------------------------------
   distinct_blobs: blobs without one of the same place and size whose center is more certain
   (twin: candidates.py, _distinct).

   order (k): the blobs by their columns; center (k, 2), semi (k, 2), variance, side (k); settings: share of the place, of
   the size, pixels of the level, size in between both groups. Writes kept (k). */

void distinct_blobs(int64_t k, const int64_t *order, const double *center, const double *semi, const double *variance,
                    const double *side, const double *settings, uint8_t *kept)
{
    const double large = settings[3];
    for (int64_t i = 0; i < k; i++)
        kept[i] = 1;
    for (int64_t first = 0; first < k; first++) {
        const int64_t i = order[first];
        const double a = semi[2 * i], b = semi[2 * i + 1], reach = settings[0] * b;
        for (int64_t second = first + 1; second < k; second++) {
            const int64_t j = order[second];
            const double c = semi[2 * j], d = semi[2 * j + 1];
            if (!(center[2 * j] - center[2 * i] < reach))
                break;
            if (!(fabs(center[2 * j + 1] - center[2 * i + 1]) < reach))
                continue;
            const double same = settings[1] * larger(b, d) + settings[2] * (side[i] == side[j] ? 0 : larger(side[i], side[j]));
            const int group = (b < 2 * large && d < 2 * large) || (b > large && d > large);
            if (group && fabs(a - c) < same && fabs(b - d) < same)
                kept[variance[i] <= variance[j] ? j : i] = 0;
        }
    }
}
