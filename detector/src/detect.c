/* A frame: from grey levels to labeled dots and poses.

   Blobs, the most dot-like first, are labeled layout by layout; the dots of the best labeling are fitted to the grey levels
   and judged again beside its rivals; what is certain then is found, and its blobs are taken. So it goes on until no layout
   has a labeling that is no accident. */

#define _POSIX_C_SOURCE 199309L

#include "label.h"

#include <time.h>

/* Least difference of evidence between a labeling and any that contradicts it: odds of 10,000. */
static const double MARGIN = 9.2;

/* Labelings of one layout, or bodies of the same dots, that do not hold once their dots are fitted, before the search for it
   ends: in 800 views there was one at most, regular patterns have thousands. */
enum { RESTARTS = 4 };

typedef struct {
    Pool pool;
    int64_t left, restarts;
    int searched, cut, ended, state;
    int64_t rival, tag, count, missing;
    double evidence;
} Quest;

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static int late(const Budget *budget) { return budget->until > 0 && now() > budget->until; }

/* Drops the labelings of a pool with blobs that are taken. */
static void drop_taken(const Scene *scene, const Layout *layout, Pool *pool)
{
    for (int64_t i = 0; i < pool->count; i++) {
        int taken = 0;
        for (int64_t d = 0; d < layout->count; d++)
            taken |= pool->best[i].labels[d] >= 0 && scene->taken[pool->best[i].labels[d]];
        if (!taken)
            continue;
        const Labeling dropped = pool->best[i];
        pool->best[i] = pool->best[--pool->count];
        pool->best[pool->count] = dropped;
        i--;
    }
}

static void forget(Scene *scene)
{
    for (int64_t k = 0; k < scene->count; k++)
        scene->shown[k].clutter = -1;
}

/* Fits the blobs of a labeling that are not fitted yet; returns how many, or NO_MEMORY. */
static int64_t fit_dots_of(Scene *scene, const Layout *layout, const Labeling *labeling, const Image *image, int64_t *which)
{
    int64_t count = 0;
    for (int64_t d = 0; d < layout->count; d++)
        if (labeling->labels[d] >= 0 && scene->blobs[labeling->labels[d]].state == ROUGH)
            which[count++] = labeling->labels[d];
    if (!count || !image)
        return 0;
    if (fit_blobs(image, scene->blobs, which, count))
        return NO_MEMORY;
    undo_lens(scene->camera, scene->blobs, which, count);
    for (int64_t i = 0; i < count; i++) {
        if (!scene->blobs[which[i]].known)
            scene->taken[which[i]] = 1;
        else
            update_blob(scene, which[i]);
    }
    return count;
}

/* Whether two labelings of different layouts have most blobs of the smaller one in common. */
static int share(const Layout *one, const Labeling *a, const Layout *other, const Labeling *b)
{
    int64_t shared = 0;
    for (int64_t i = 0; i < one->count; i++)
        for (int64_t j = 0; j < other->count && a->labels[i] >= 0; j++)
            shared += a->labels[i] == b->labels[j];
    const int64_t fewer = a->count < b->count ? a->count : b->count;
    return 2 * shared >= fewer;
}

static int add_finding(Findings *findings, const Layout *layout, const Labeling *labeling, const Finding *base)
{
    Finding *grown = realloc(findings->findings, (size_t)(findings->count + 1) * sizeof *grown);
    if (!grown)
        return NO_MEMORY;
    findings->findings = grown;
    Finding *finding = grown + findings->count;
    *finding = *base;
    finding->dots = finding->blobs = NULL;
    finding->pixels = NULL;
    findings->count++;
    if (!labeling)
        return 0;
    finding->count = labeling->count;
    finding->missing = labeling->missing;
    finding->evidence = labeling->evidence;
    finding->sigma = labeling->sigma;
    finding->pose = labeling->pose;
    finding->dots = malloc((size_t)(2 * labeling->count + 1) * sizeof *finding->dots);
    if (!finding->dots)
        return NO_MEMORY;
    finding->blobs = finding->dots + labeling->count;
    int64_t m = 0;
    for (int64_t d = 0; d < layout->count && m < labeling->count; d++)
        if (labeling->labels[d] >= 0) {
            finding->dots[m] = d;
            finding->blobs[m++] = labeling->labels[d];
        }
    return 0;
}

int64_t label_frame(const Model *model, const Camera *camera, int calibrated, const Image *image, const Options *options,
                    Findings *findings)
{
    const double FOCALS[] = {1, 0.4, 3};
    Scene scene;
    Work work;
    int64_t status = 0, most = 0;
    Quest *quests = calloc((size_t)model->layout_count + 1, sizeof *quests);
    for (int64_t l = 0; l < model->layout_count; l++)
        most = model->layouts[l].count > most ? model->layouts[l].count : most;
    int64_t *which = malloc((size_t)(most + 1) * sizeof *which);
    const int failed = !quests || !which;
    if (scene_of(&scene, camera, calibrated, findings->blobs, findings->blob_count) || work_for(&work, most, scene.count) || failed)
        status = NO_MEMORY;
    Budget budget = {options->steps, late, options->deadline > 0 ? now() + options->deadline : 0};
    for (int64_t l = 0; l < model->layout_count && !status; l++) {
        status = pool_for(&quests[l].pool, model->layouts[l].count);
        quests[l].left = options->copies;
        quests[l].state = FEW;
        quests[l].rival = quests[l].tag = -1;
        quests[l].evidence = -INFINITY;
    }
    while (!status) {
        int64_t best = -1;
        const Labeling *first = NULL;
        for (int64_t l = 0; l < model->layout_count; l++) {
            Quest *quest = quests + l;
            if (quest->ended || !quest->left)
                continue;
            if (!quest->searched) {
                quest->pool.count = 0;
                for (int f = 0; f < (calibrated ? 1 : 3); f++) {
                    if (!calibrated)
                        scene_focal(&scene, FOCALS[f]);
                    search(&scene, model->layouts + l, &budget, quest->left == options->copies, &work, &quest->pool);
                    quest->cut |= work.cut;
                    if (best_of(&quest->pool)->evidence > SURE)
                        break;
                }
                quest->searched = 1;
            }
            const Labeling *own = best_of(&quest->pool);
            if (own->evidence > quest->evidence && quest->left == options->copies) {
                quest->evidence = own->evidence;
                quest->state = own->count >= LEAST_DOTS ? UNSURE : UNFIT;
                quest->count = own->count;
                quest->missing = own->missing;
            }
            /* Rough outlines have less to say: fitted, they may say more. */
            if (!(own->evidence > SURE / 2)) {
                quest->ended = 1;
                continue;
            }
            if (best < 0 || own->evidence > first->evidence) {
                best = l;
                first = own;
            }
        }
        if (best < 0)
            break;
        Quest *quest = quests + best;
        const Layout *layout = model->layouts + best;
        const int64_t fresh = fit_dots_of(&scene, layout, first, image, which);
        if (fresh < 0) {
            status = NO_MEMORY;
            break;
        }
        if (fresh) {
            forget(&scene);
            for (int64_t l = 0; l < model->layout_count; l++)
                for (int64_t i = 0; i < quests[l].pool.count; i++)
                    settle(&scene, model->layouts + l, quests[l].pool.best + i, &work);
            /* Others may be better now. */
            if (quest->restarts++ < RESTARTS)
                continue;
        }
        add_rivals(&scene, layout, &work, &quest->pool);
        Labeling chosen = *best_of(&quest->pool);
        if (fit_dots_of(&scene, layout, &chosen, image, which) > 0) {
            forget(&scene);
            for (int64_t i = 0; i < quest->pool.count; i++)
                fit_labeling(&scene, layout, quest->pool.best + i, &work);
            chosen = *best_of(&quest->pool);
        }
        if (!(chosen.evidence > SURE + log((double)model->layout_count))) {
            quest->ended = 1;
            continue;
        }
        Finding finding = {0};
        finding.rival = finding.tag = -1;
        finding.state = FOUND;
        finding.cut = quest->cut;
        finding.margin = INFINITY;
        for (int64_t i = 0; i < quest->pool.count; i++) {
            const Labeling *other = quest->pool.best + i;
            if (other->labels != chosen.labels && contradict(layout, &chosen, other) && chosen.evidence - other->evidence < finding.margin)
                finding.margin = chosen.evidence - other->evidence;
        }
        if (finding.margin < MARGIN)
            finding.state = AMBIGUOUS;
        for (int64_t l = 0; l < model->layout_count; l++) {
            const Labeling *other = best_of(&quests[l].pool);
            if (l == best || !quests[l].searched || !(other->evidence > chosen.evidence - MARGIN) ||
                !share(layout, &chosen, model->layouts + l, other))
                continue;
            finding.state = CLAIMED;
            finding.rival = l;
        }
        finding.member = (int32_t)best;
        if (finding.state == FOUND || quest->left == options->copies)
            status = add_finding(findings, layout, &chosen, &finding);
        if (finding.state == CLAIMED) {
            /* Neither has them. */
            quests[finding.rival].ended = 1;
            quests[finding.rival].state = CLAIMED;
            quests[finding.rival].rival = best;
        }
        quest->left = finding.state == FOUND ? quest->left - 1 : 0;
        quest->state = finding.state;
        for (int64_t d = 0; d < layout->count; d++)
            if (chosen.labels[d] >= 0)
                scene.taken[chosen.labels[d]] = 1;
        forget(&scene);
        for (int64_t l = 0; l < model->layout_count; l++) {
            Quest *own = quests + l;
            drop_taken(&scene, model->layouts + l, &own->pool);
            own->restarts = 0;
            if (!own->pool.count)
                own->searched = 0;
        }
    }
    for (int64_t l = 0; l < model->layout_count && !status; l++)
        if (quests[l].state != FOUND && quests[l].state != AMBIGUOUS && !(quests[l].left < options->copies)) {
            Finding finding = {0};
            finding.member = (int32_t)l;
            finding.state = quests[l].state;
            finding.cut = quests[l].cut;
            finding.rival = quests[l].rival;
            finding.tag = quests[l].tag;
            finding.count = quests[l].count;
            finding.missing = quests[l].missing;
            finding.evidence = quests[l].evidence;
            status = add_finding(findings, model->layouts + l, NULL, &finding);
        }
    for (int64_t i = 0; i < findings->count && !status; i++)
        if (findings->findings[i].dots)
            status = complete_finding(model->layouts + findings->findings[i].member, camera, calibrated, findings->blobs,
                                      findings->findings + i);
    for (int64_t l = 0; l < model->layout_count && quests; l++)
        free(quests[l].pool.memory);
    scene_free(&scene);
    work_free(&work);
    free(quests);
    free(which);
    return status;
}

int64_t detect_frame(const Model *model, const Camera *camera, int calibrated, const Image *image, const Options *options,
                     Findings *findings)
{
    memset(findings, 0, sizeof *findings);
    findings->blob_count = find_blobs(image, options->smallest, options->blobs, &findings->blobs);
    if (findings->blob_count < 0)
        return NO_MEMORY;
    undo_lens(camera, findings->blobs, NULL, findings->blob_count);
    return label_frame(model, camera, calibrated, image, options, findings);
}

void findings_free(Findings *findings)
{
    for (int64_t i = 0; i < findings->count; i++)
        free(findings->findings[i].dots), free(findings->findings[i].pixels);
    free(findings->findings);
    free(findings->blobs);
    memset(findings, 0, sizeof *findings);
}
