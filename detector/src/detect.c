/* A frame: from grey levels to labeled dots and poses.

   Blobs, the most dot-like first, are labeled layout by layout; the dots of the best labeling are fitted to the grey levels
   and judged again beside its rivals; what is certain then is found, and its blobs are taken. So it goes on until no layout
   has a labeling that is no accident. */

#define _POSIX_C_SOURCE 199309L

#include "label.h"
#include "numbers.h"

#include <time.h>

/* Least difference of evidence between a labeling and any that contradicts it: odds of 3,000. */
static const double MARGIN = 8;

/* Labelings of one layout, or bodies of the same dots, that do not hold once their dots are fitted, before the search for it
   ends: in 800 views there was one at most, regular patterns have thousands. */
enum { RESTARTS = 4, NOTHING = -2 };

/* Why a search for a layout has ended: none of the blobs that are left shows it, or they are not to be asked again. */
enum { NONE_LEFT = 1, CLOSED };

/* Angle by which a plate is turned that is not in its place, rad: poses of single plates err by less. */
static const double TURNED = 0.26;

/* Narrowest cell of a tag that is read, px: at 2 px, 98 % of 4 x 4 bits are read over the usual poses, at 1.5 px 85 %. */
static const double LEAST_CELL_PX = 1.2;

/* Least logarithm of the likelihood ratio of a tag of which a part is seen, to other members of its family and to strangers. */
static const double AGREES = 4.6;

/* What is left to find of a layout, and why nothing was found. */
typedef struct {
    Pool pool;
    int64_t members, copies, left, restarts; /* bodies of the layout; copies found, and looked for */
    int searched, ended;
    Finding why;
} Quest;

typedef struct {
    const Model *model;
    const Camera *camera;
    int calibrated;
    const Image *image;
    const Options *options;
    Findings *findings;
    Quest *quests;
    Scene scene;
    Work work;
    Budget budget;
    int64_t *which;
} Frame;

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static int late(const Budget *budget) { return budget->until > 0 && now() > budget->until; }

/* What clutter shows is to be asked again. */
static void forget(Scene *scene)
{
    for (int64_t k = 0; k < scene->count; k++)
        scene->looks[k].clutter = -1;
}

/* Takes the blobs of a labeling, and drops the other labelings with any of these. */
static void take(Frame *frame, const Layout *layout, const Labeling *labeling)
{
    Scene *scene = &frame->scene;
    for (int64_t d = 0; d < layout->count; d++)
        if (labeling->labels[d] >= 0)
            scene->taken[labeling->labels[d]] = 1;
    forget(scene);
    for (int64_t l = 0; l < frame->model->layout_count; l++) {
        Pool *pool = &frame->quests[l].pool;
        for (int64_t i = 0; i < pool->count; i++) {
            int taken = 0;
            for (int64_t d = 0; d < frame->model->layouts[l].count; d++)
                taken |= pool->best[i].labels[d] >= 0 && scene->taken[pool->best[i].labels[d]];
            if (taken)
                drop(pool, i--);
        }
        Quest *quest = frame->quests + l;
        quest->restarts = 0;
        /* What cut a search short may have been the dots that are taken now. */
        const int again = quest->ended == NONE_LEFT && quest->why.cut;
        if (again)
            quest->ended = 0;
        if (again || !pool->count)
            quest->searched = 0;
    }
}

/* Fits the blobs of a labeling that are not fitted yet; returns how many, or NO_MEMORY. */
static int64_t fit_dots_of(Frame *frame, const Layout *layout, const Labeling *labeling)
{
    Scene *scene = &frame->scene;
    int64_t count = 0, *which = frame->which;
    for (int64_t d = 0; d < layout->count; d++)
        if (labeling->labels[d] >= 0 && scene->blobs[labeling->labels[d]].state == ROUGH)
            which[count++] = labeling->labels[d];
    if (!count || !frame->image)
        return 0;
    if (fit_blobs(frame->image, scene->camera, scene->blobs, which, count))
        return NO_MEMORY;
    undo_lens(scene->camera, scene->blobs, which, count);
    for (int64_t i = 0; i < count; i++)
        if (scene->blobs[which[i]].reached)
            update_blob(scene, which[i]);
        else
            scene->taken[which[i]] = 1;
    forget(scene);
    return count;
}

/* Whether two labelings of different layouts have most blobs of the smaller one in common. */
static int share(const Layout *one, const Labeling *a, const Layout *other, const Labeling *b)
{
    int64_t shared = 0;
    for (int64_t i = 0; i < one->count; i++)
        for (int64_t j = 0; j < other->count && a->labels[i] >= 0; j++)
            shared += a->labels[i] == b->labels[j];
    return 2 * shared >= (a->count < b->count ? a->count : b->count);
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

/* Adds a finding that is not FOUND for each member of a layout; its rival is the first other member of the same layout, or of
   the layout `rival`. */
static int add_findings(Frame *frame, int64_t l, const Labeling *labeling, const Finding *base)
{
    const Model *model = frame->model;
    int status = 0;
    for (int64_t k = 0; k < model->member_count && !status; k++) {
        Finding finding = *base;
        if (model->members[k].layout != l)
            continue;
        finding.member = (int32_t)k;
        finding.rival = -1;
        for (int64_t o = model->member_count - 1; o >= 0; o--)
            if (o != k && model->members[o].layout == (base->rival < 0 ? l : base->rival))
                finding.rival = o;
        if (base->state != CLAIMED && base->state != HIDDEN_TAG)
            finding.rival = -1;
        status = add_finding(frame->findings, model->layouts + l, labeling, &finding);
    }
    return status;
}

static int has_tag(const Model *model, int64_t l)
{
    int there = 0;
    for (int64_t k = 0; k < model->member_count; k++)
        there |= model->members[k].layout == l && model->members[k].tag_count > 0;
    return there;
}

/* Searches for a layout unless that is done. */
static void seek(Frame *frame, int64_t l)
{
    static const double FOCALS[] = {1, 0.4, 3};
    Quest *quest = frame->quests + l;
    /* All members of a family may be there; further copies are in plain sight. */
    const int first = quest->copies < quest->members;
    if (!quest->searched) {
        quest->pool.count = quest->why.cut = 0;
        for (int f = 0; f < (frame->calibrated ? 1 : 3); f++) {
            if (!frame->calibrated)
                scene_focal(&frame->scene, FOCALS[f]);
            search(&frame->scene, frame->model->layouts + l, &frame->budget, first, &frame->work, &quest->pool);
            quest->why.cut |= frame->work.cut;
            if (best_of(&quest->pool)->evidence > SURE)
                break;
        }
        quest->searched = 1;
    }
    const Labeling *best = best_of(&quest->pool);
    if (!quest->copies && best->evidence > quest->why.evidence) {
        quest->why.evidence = best->evidence;
        quest->why.state = best->evidence > 0 ? UNSURE : UNFIT;
        quest->why.count = best->count;
        quest->why.missing = best->missing;
    }
    /* Rough outlines have less to say: fitted, they may say more. */
    quest->ended = best->evidence > (has_tag(frame->model, l) ? 0 : SURE / 2) ? 0 : NONE_LEFT;
}

/* Whether a tag faces the camera. */
static int faces(const Tag *tag, const Pose *pose)
{
    const double(*c)[3] = tag->corners;
    double u[3], v[3], across[3], n[3], P[3];
    for (int a = 0; a < 3; a++) {
        u[a] = c[1][a] - c[0][a];
        v[a] = c[3][a] - c[0][a];
    }
    cross(v, u, across);
    rotated(pose->R, across, n);
    rotated(pose->R, c[0], P);
    return product(n, P) + product(n, pose->t) < 0;
}

/* What the tags say of a labeling: 1 if those that are read are the ones of a member, who becomes the finding's, -1 if one is
   another, or not where or as it should be, 0 if none is read. */
static int ask_tags(const Frame *frame, int64_t l, const Labeling *labeling, Finding *finding)
{
    const Model *model = frame->model;
    const Tag *asked[PLATES];
    TagReading readings[PLATES];
    int answer = 0, members = 0, count = 0;
    double likeliest = 0, second = 0;
    finding->tag = -1;
    finding->tag_state = TAG_NONE;
    for (int64_t k = 0; k < model->member_count; k++) {
        const Member *member = model->members + k;
        const TagReading *telling = NULL;
        int64_t where = 0;
        int right = 1;
        double agrees = 0;
        if (member->layout != l)
            continue;
        if (!members++)
            finding->member = (int32_t)k;
        for (int64_t t = 0; t < member->tag_count && right && frame->image; t++) {
            const Tag *tag = member->tags + t;
            int place = 0;
            if (!faces(tag, &labeling->pose))
                continue;
            /* Members of a family have theirs at the same places. */
            while (place < count && (asked[place]->family != tag->family || memcmp(asked[place]->corners, tag->corners, sizeof tag->corners)))
                place++;
            if (place == PLATES)
                continue;
            if (place == count) {
                asked[count++] = tag;
                read_tag(frame->image, frame->camera, &labeling->pose, tag->corners, model->families + tag->family, LEAST_CELL_PX,
                         readings + place);
            }
            const TagReading *reading = readings + place;
            if (reading->state != TAG_READ) {
                if (finding->tag_state == TAG_NONE)
                    finding->tag_state = reading->state;
                agrees += agreement(model->families + tag->family, reading, tag->code);
                continue;
            }
            right = reading->id == tag->code && !reading->mirrored && !reading->rotation;
            if (!telling || !right) {
                telling = reading;
                where = t;
            }
        }
        if (agrees > likeliest) {
            second = likeliest;
            likeliest = agrees;
            finding->member = answer ? finding->member : (int32_t)k;
        } else
            second = fmax(second, agrees);
        if (!telling || (answer && !right))
            continue;
        answer = right ? 1 : -1;
        finding->state = right ? FOUND : telling->mirrored ? MIRRORED : OTHER_TAG;
        finding->tag_state = TAG_READ;
        finding->tag = telling->id;
        finding->tag_place = where;
        finding->tag_family = (int32_t)member->tags[where].family;
        memcpy(finding->corners, telling->corners, sizeof finding->corners);
        if (right) {
            finding->member = (int32_t)k;
            return 1;
        }
    }
    if (!answer && likeliest - second > AGREES)
        return 0;
    /* Without it, which of a family's members it is, or whether it is a stranger to all of them, is not known. */
    if (!answer && count && (members > 1 || (finding->tag_state >= TAG_FAINT && model->layouts[l].plate_count == 1)))
        finding->state = HIDDEN_TAG;
    else if (!answer && members > 1)
        finding->state = CLAIMED;
    return answer;
}

/* ---- bodies that are put together otherwise ---- */

/* One plate of a layout as a layout of its own, in the body's frame; its constellations are freed by the caller. */
static int plate_layout(const Layout *layout, int64_t plate, Layout *alone)
{
    int64_t first = 0, count = 0, parts = 0, dots = 0;
    for (int64_t d = 0; d < layout->count; d++)
        if (layout->dots[d].plate == plate && !count++)
            first = d;
    Constellation *constellations = calloc((size_t)layout->constellation_count + 1, sizeof *constellations);
    int64_t *numbers = malloc((size_t)(layout->count + 1) * sizeof *numbers);
    *alone = *layout;
    alone->count = count;
    alone->dots = layout->dots + first;
    alone->constellations = constellations;
    if (!constellations || !numbers) {
        free(constellations);
        free(numbers);
        return NO_MEMORY;
    }
    constellations[layout->constellation_count].dots = numbers;
    for (int64_t c = 0; c < layout->constellation_count; c++) {
        if (layout->constellations[c].plate != plate)
            continue;
        constellations[parts] = layout->constellations[c];
        constellations[parts++].dots = numbers + dots;
        for (int64_t i = 0; i < layout->constellations[c].count; i++)
            numbers[dots++] = layout->constellations[c].dots[i] - first;
    }
    alone->constellation_count = parts;
    for (int a = 0; a < 3; a++) {
        alone->middle[a] = 0;
        for (int64_t d = 0; d < count; d++)
            alone->middle[a] += alone->dots[d].xyz[a] / (double)count;
    }
    return 0;
}

/* The place that a plate seen with one pose of the body has in a body with another pose: the plate whose place it is, and by
   how much it is turned there, rad; -1 if it is the place of none. */
static int64_t place_of(const Layout *layout, int64_t plate, const Pose *body, const Pose *seen, double *angle)
{
    const Pose in_camera = joined(seen, layout->plates + plate), to_plate = inverse_of(&in_camera), of_body = joined(&to_plate, body);
    double nearest = layout->extent / 2;
    int64_t place = -1;
    for (int64_t p = 0; p < layout->plate_count; p++) {
        const Pose other = joined(&of_body, layout->plates + p);
        const double away = sqrt(product(other.t, other.t));
        if (!(away < nearest) || other.R[8] < 0.87)
            continue;
        nearest = away;
        place = p;
        *angle = atan2(other.R[1], other.R[0]);
    }
    return place;
}

/* The pose of the body if a plate that was seen with some pose of it is in the place of another one. */
static Pose exchanged(const Pose *plate, const Pose *other, const Pose *seen)
{
    const Pose in_camera = joined(seen, plate), to_body = inverse_of(other);
    return joined(&in_camera, &to_body);
}

/* Whether the mirrored image of a layout is there, with more evidence than the layout; pool is one for it. */
static int is_mirrored(Frame *frame, const Layout *layout, Pool *pool, double evidence)
{
    /* Most images are of something else, and a mirrored body is in plain sight. */
    const Budget budget = {frame->budget.steps / 3, late, frame->budget.until};
    pool->count = 0;
    mirror_scene(&frame->scene);
    search(&frame->scene, layout, &budget, 0, &frame->work, pool);
    mirror_scene(&frame->scene);
    return best_of(pool)->evidence > fmax(SURE, evidence) + 10;
}

/* Looks for each plate by itself where a body's labeling has left a plate's dots unexplained, or another one contradicts it:
   plates that are not at their places become the finding's, those that are mirrored with a turn that is nan. Returns how many, or
   NO_MEMORY. */
static int contradictions(Frame *frame, const Layout *layout, const Labeling *chosen, Finding *finding)
{
    Pose poses[PLATES];
    int64_t plates[PLATES], count = 0, unexplained = 0, mirrored[PLATES], mirrors = 0;
    for (int64_t p = 0; p < layout->plate_count && finding->state == FOUND; p++) {
        int64_t missing = 0, there = 0;
        for (int64_t d = 0; d < layout->count; d++)
            if (layout->dots[d].plate == p) {
                there += chosen->labels[d] >= 0;
                missing += chosen->labels[d] < 0 && in_plain_view(&frame->scene, layout->dots + d, &chosen->pose);
            }
        unexplained += missing >= LEAST_DOTS - 1 && missing > there;
    }
    if (layout->plate_count < 2 || (finding->state == FOUND && !unexplained))
        return 0;
    for (int64_t p = 0; p < layout->plate_count && count < PLATES; p++) {
        Layout alone;
        Pool pool;
        if (plate_layout(layout, p, &alone))
            return NO_MEMORY;
        if (pool_for(&pool, alone.count))
            count = NO_MEMORY;
        else if (alone.constellation_count) {
            search(&frame->scene, &alone, &frame->budget, 0, &frame->work, &pool);
            if (best_of(&pool)->evidence > SURE) {
                poses[count] = best_of(&pool)->pose;
                plates[count++] = p;
            } else if (unexplained && mirrors < PLATES && is_mirrored(frame, &alone, &pool, 0))
                mirrored[mirrors++] = p;
        }
        free((void *)alone.constellations[layout->constellation_count].dots);
        free((void *)alone.constellations);
        free(pool.memory);
        if (count < 0)
            return NO_MEMORY;
    }
    /* The body is where most plates agree with it; else where two are exchanged, or turned, or in other places. */
    int64_t most = -1, places[PLATES] = {0};
    double turns[PLATES] = {0};
    for (int64_t i = 0; i < count; i++)
        for (int64_t j = 0; j < count; j++) {
            Pose body = poses[i];
            if (i != j)
                body = exchanged(layout->plates + plates[i], layout->plates + plates[j], poses + i);
            int64_t taken[PLATES], score = 0;
            double angles[PLATES] = {0};
            for (int64_t k = 0; k < count; k++)
                taken[k] = place_of(layout, plates[k], &body, poses + k, angles + k);
            for (int64_t k = 0; k < count; k++) {
                int mutual = 0;
                for (int64_t m = 0; m < count; m++)
                    mutual |= m != k && taken[k] == plates[m] && taken[m] == plates[k];
                score += taken[k] == plates[k] ? 4 : mutual ? 3 : taken[k] >= 0 ? 0 : -2;
                score += taken[k] >= 0 && fabs(angles[k]) < TURNED ? 2 : 0;
            }
            if (score > most) {
                most = score;
                memcpy(places, taken, sizeof taken);
                memcpy(turns, angles, sizeof angles);
            }
        }
    finding->misplaced = 0;
    for (int64_t k = 0; k < count; k++) {
        if (places[k] == plates[k] && fabs(turns[k]) < TURNED)
            continue;
        finding->plates[finding->misplaced] = plates[k];
        finding->places[finding->misplaced] = places[k];
        finding->plate_turns[finding->misplaced++] = turns[k];
    }
    for (int64_t k = 0; k < mirrors && finding->misplaced < PLATES; k++) {
        finding->plates[finding->misplaced] = finding->places[finding->misplaced] = mirrored[k];
        finding->plate_turns[finding->misplaced++] = NAN;
    }
    return (int)finding->misplaced;
}

/* Judges the best labeling of a layout beside its rivals, with what tags say; returns its place in the pool, -1 if none holds. */
static int64_t judge_labelings(Frame *frame, int64_t l, Finding *finding, int *strangers)
{
    Quest *quest = frame->quests + l;
    const Layout *layout = frame->model->layouts + l;
    Finding refuted = {0};
    frame->work.chosen[0] = NOTHING;
    while (1) {
        const int64_t chosen = best_of(&quest->pool) - quest->pool.best;
        /* A tag that is read tells as much as what is lacking here. */
        const double sure = SURE + log((double)frame->model->layout_count);
        const double least = refuted.state ? refuted.evidence - MARGIN : has_tag(frame->model, l) ? 0 : sure;
        if (!quest->pool.count || !(quest->pool.best[chosen].evidence > least)) {
            if (refuted.state)
                *finding = refuted;
            if (refuted.state && frame->work.chosen[0] != NOTHING) {
                const Labeling other = {.labels = frame->work.chosen};
                take(frame, layout, &other);
                *strangers = 1;
            }
            return -1;
        }
        finding->state = FOUND;
        finding->margin = INFINITY;
        const int answer = ask_tags(frame, l, quest->pool.best + chosen, finding);
        if (answer < 0) {
            if (!refuted.state) {
                refuted = *finding;
                refuted.evidence = quest->pool.best[chosen].evidence;
                refuted.count = quest->pool.best[chosen].count;
                memcpy(frame->work.chosen, quest->pool.best[chosen].labels, (size_t)layout->count * sizeof(int64_t));
            }
            drop(&quest->pool, chosen);
            continue;
        }
        for (int64_t i = 0; i < quest->pool.count; i++) {
            const Labeling *rival = quest->pool.best + i;
            const double less = quest->pool.best[chosen].evidence - rival->evidence;
            if (i != chosen && less < finding->margin && contradict(layout, quest->pool.best + chosen, rival))
                finding->margin = less;
        }
        if (answer > 0) {
            finding->margin = INFINITY;
            return chosen;
        }
        if (!(quest->pool.best[chosen].evidence > sure)) {
            drop(&quest->pool, chosen);
            continue;
        }
        if (!(finding->margin < MARGIN))
            return chosen;
        /* A tag may tell between them. */
        int asked = 0;
        for (int64_t i = 0; i < quest->pool.count; i++) {
            const Labeling *rival = quest->pool.best + i;
            if (i == chosen || !(quest->pool.best[chosen].evidence - rival->evidence < MARGIN) ||
                !contradict(layout, quest->pool.best + chosen, rival))
                continue;
            Finding second = *finding;
            const int of_rival = ask_tags(frame, l, rival, &second);
            if (of_rival > 0) {
                *finding = second;
                finding->margin = INFINITY;
                return i;
            }
            if (of_rival < 0) {
                drop(&quest->pool, i);
                asked = 1;
                break;
            }
        }
        if (asked)
            continue;
        finding->state = frame->options->symmetric ? FOUND : AMBIGUOUS;
        finding->turns = turns_of(layout, &quest->pool, chosen, MARGIN, finding->turn);
        return chosen;
    }
}

/* Leaves out dots of other plates whose fit is refused: seen at a grazing angle, they are two px thin and off by one. */
static void leave_refused(const Frame *frame, const Layout *layout, Labeling *labeling)
{
    int64_t fitted = 0;
    for (int64_t d = 0; d < layout->count; d++)
        fitted += labeling->labels[d] >= 0 && frame->scene.blobs[labeling->labels[d]].state != REFUSED;
    for (int64_t d = 0; d < layout->count && layout->plate_count > 1 && fitted > LEAST_DOTS; d++)
        if (labeling->labels[d] >= 0 && frame->scene.blobs[labeling->labels[d]].state == REFUSED) {
            labeling->labels[d] = -1;
            labeling->count--;
        }
}

/* Looks for the next body; returns 1 if there may be more, 0 if there are none, or NO_MEMORY. */
static int next_finding(Frame *frame)
{
    const Model *model = frame->model;
    int64_t best = -1;
    double most = -INFINITY;
    for (int64_t l = 0; l < model->layout_count; l++) {
        Quest *quest = frame->quests + l;
        if (quest->ended || !quest->left)
            continue;
        seek(frame, l);
        if (!quest->ended && best_of(&quest->pool)->evidence > most) {
            best = l;
            most = best_of(&quest->pool)->evidence;
        }
    }
    if (best < 0)
        return 0;
    Quest *quest = frame->quests + best;
    const Layout *layout = model->layouts + best;
    const int64_t fresh = fit_dots_of(frame, layout, best_of(&quest->pool));
    if (fresh < 0)
        return NO_MEMORY;
    if (fresh) {
        for (int64_t l = 0; l < model->layout_count; l++)
            for (int64_t i = 0; i < frame->quests[l].pool.count; i++)
                settle(&frame->scene, model->layouts + l, frame->quests[l].pool.best + i, -INFINITY, &frame->work);
        /* Others may be better now. */
        if (quest->restarts++ < RESTARTS)
            return 1;
    }
    add_rivals(&frame->scene, layout, &frame->work, &quest->pool);
    /* With each fit, another one may be the best. */
    for (int64_t more; (more = fit_dots_of(frame, layout, best_of(&quest->pool)));) {
        if (more < 0)
            return NO_MEMORY;
        for (int64_t i = 0; i < quest->pool.count; i++)
            fit_labeling(&frame->scene, layout, quest->pool.best + i, &frame->work);
    }
    Finding finding = {0};
    finding.rival = finding.tag = -1;
    finding.cut = quest->why.cut;
    int strangers = 0;
    const int64_t place = judge_labelings(frame, best, &finding, &strangers);
    if (place < 0) {
        if (finding.state && !quest->copies)
            quest->why = finding;
        /* Another marker than the one that is looked for has these dots. */
        quest->ended = finding.state && strangers ? 0 : CLOSED;
        return 1;
    }
    Labeling *chosen = quest->pool.best + place;
    leave_refused(frame, layout, chosen);
    const int misplaced = contradictions(frame, layout, chosen, &finding);
    if (misplaced < 0)
        return NO_MEMORY;
    if (misplaced)
        finding.state = CONTRADICTED;
    if (finding.state == AMBIGUOUS && !quest->copies) {
        Pool pool;
        if (pool_for(&pool, layout->count))
            return NO_MEMORY;
        const int mirrored = is_mirrored(frame, layout, &pool, chosen->evidence);
        free(pool.memory);
        if (mirrored) {
            quest->why = finding;
            quest->why.state = MIRRORED;
            quest->ended = CLOSED;
            return 1;
        }
    }
    int status = 0;
    for (int64_t l = 0; l < model->layout_count && !status; l++) {
        Quest *other = frame->quests + l;
        if (l == best || !other->searched || !(best_of(&other->pool)->evidence > chosen->evidence - MARGIN) ||
            !share(layout, chosen, model->layouts + l, best_of(&other->pool)))
            continue;
        /* Neither has them. */
        Finding claim = {0};
        claim.state = finding.state = CLAIMED;
        claim.tag = claim.tag_state = -1;
        claim.rival = best;
        finding.rival = l;
        other->ended = CLOSED;
        if (!other->copies)
            status = add_findings(frame, l, best_of(&other->pool), &claim);
    }
    if (!status && (finding.state == FOUND || !quest->copies))
        status = finding.state == FOUND ? add_finding(frame->findings, layout, chosen, &finding)
                                        : add_findings(frame, best, chosen, &finding);
    if (finding.state == FOUND && finding.tag >= 0 && !quest->copies) {
        quest->why.state = OTHER_TAG;
        quest->why.tag = finding.tag;
        quest->why.tag_place = finding.tag_place;
        quest->why.tag_family = finding.tag_family;
        quest->why.tag_state = TAG_READ;
    }
    quest->left = finding.state == FOUND ? quest->left - 1 : 0;
    quest->copies++;
    take(frame, layout, chosen);
    return status ? status : 1;
}

static int64_t label_blobs(const Model *model, const Camera *camera, int calibrated, const Image *image, const Options *options,
                           double until, Findings *findings)
{
    Frame frame = {model, camera, calibrated, image, options, findings, NULL, {0}, {0}, {0}, NULL};
    int64_t status = 0, most = 0;
    for (int64_t l = 0; l < model->layout_count; l++)
        most = model->layouts[l].count > most ? model->layouts[l].count : most;
    frame.quests = calloc((size_t)model->layout_count + 1, sizeof *frame.quests);
    frame.which = malloc((size_t)(most + 1) * sizeof *frame.which);
    if (!frame.quests || !frame.which || scene_of(&frame.scene, camera, calibrated, findings->blobs, findings->blob_count) ||
        work_for(&frame.work, most))
        status = NO_MEMORY;
    frame.budget = (Budget){options->steps, late, until};
    for (int64_t l = 0; l < model->layout_count && !status; l++) {
        Quest *quest = frame.quests + l;
        status = pool_for(&quest->pool, model->layouts[l].count);
        for (int64_t k = 0; k < model->member_count; k++)
            quest->members += model->members[k].layout == l;
        quest->left = options->copies * quest->members;
        quest->why.state = findings->blob_count < LEAST_DOTS ? FEW : UNFIT;
        quest->why.rival = quest->why.tag = quest->why.tag_state = -1;
        quest->why.evidence = -INFINITY;
    }
    while (!status) {
        const int more = next_finding(&frame);
        if (more <= 0) {
            status = more;
            break;
        }
    }
    for (int64_t k = 0; k < model->member_count && !status; k++) {
        const int64_t l = model->members[k].layout;
        int there = 0;
        for (int64_t i = 0; i < findings->count; i++)
            there |= findings->findings[i].member == k;
        if (there)
            continue;
        Finding *why = &frame.quests[l].why;
        const int unfit = why->state == UNFIT || why->state == UNSURE;
        const int searched = unfit && findings->blob_count >= LEAST_DOTS && !late(&frame.budget);
        if (searched && is_mirrored(&frame, model->layouts + l, &frame.quests[l].pool, why->evidence))
            why->state = MIRRORED;
        Finding finding = *why;
        finding.member = (int32_t)k;
        status = add_finding(findings, NULL, NULL, &finding);
    }
    for (int64_t i = 0; i < findings->count && !status; i++)
        if (findings->findings[i].dots)
            status = complete_finding(model->layouts + model->members[findings->findings[i].member].layout, camera, calibrated,
                                      findings->blobs, findings->findings + i);
    for (int64_t l = 0; l < model->layout_count && frame.quests; l++)
        free(frame.quests[l].pool.memory);
    scene_free(&frame.scene);
    work_free(&frame.work);
    free(frame.quests);
    free(frame.which);
    return status;
}

static const Finding *likeliest(const Findings *findings)
{
    const Finding *best = NULL;
    for (int64_t i = 0; i < findings->count; i++)
        if (findings->findings[i].dots && (!best || findings->findings[i].evidence > best->evidence))
            best = findings->findings + i;
    return best;
}

/* Labels the blobs of findings anew through another lens, and replaces these if the likeliest one has more evidence: 1, else 0, or
   NO_MEMORY. */
static int64_t label_through(const Model *model, const Camera *bent, const Image *image, const Options *options, double until,
                             Findings *findings)
{
    Findings again = {0};
    again.blobs = malloc((size_t)(findings->blob_count + 1) * sizeof *again.blobs);
    if (!again.blobs)
        return NO_MEMORY;
    again.blob_count = findings->blob_count;
    memcpy(again.blobs, findings->blobs, (size_t)again.blob_count * sizeof *again.blobs);
    undo_lens(bent, again.blobs, NULL, again.blob_count);
    const int64_t status = label_blobs(model, bent, 0, image, options, until, &again);
    const Finding *before = likeliest(findings), *after = likeliest(&again);
    const int better = !status && after && (!before || after->evidence > before->evidence);
    Findings dropped = better ? *findings : again;
    if (better)
        *findings = again;
    findings_free(&dropped);
    return status ? status : better;
}

/* Labels through the lens that explains best how dots miss a homography, until that finds no more. */
static int64_t free_lens(const Model *model, const Image *image, const Options *options, double until, Findings *findings)
{
    enum { ROUNDS = 3 }; /* through a lens with k1 -0.45, two find the whole of a grid of which half is found at first */
    int64_t status = 1;
    for (int round = 0; round < ROUNDS && status > 0; round++) {
        const Finding *best = likeliest(findings);
        if (!best || !(best->bend > 0))
            return 0;
        const Camera bent = best->bent;
        status = label_through(model, &bent, image, options, until, findings);
    }
    return status < 0 ? status : 0;
}

int64_t label_frame(const Model *model, const Camera *camera, int calibrated, const Image *image, const Options *options,
                    Findings *findings)
{
    /* Strengths of equidistant lenses, k1 about -0.5 and -1.6, that are tried where less than five sixths are found. */
    static const double STRONG[] = {1.2, 2.2};
    const double until = options->deadline > 0 ? now() + options->deadline : 0;
    int64_t status = label_blobs(model, camera, calibrated, image, options, until, findings);
    if (calibrated || status)
        return status;
    status = free_lens(model, image, options, until, findings);
    for (size_t k = 0; k < sizeof STRONG / sizeof *STRONG && !status; k++) {
        const Finding *best = likeliest(findings);
        double evidence = 0; /* of labelings that might be accidents, too: without any, other lenses cost time for nothing */
        for (int64_t i = 0; i < findings->count; i++)
            evidence = fmax(evidence, findings->findings[i].evidence);
        if (best ? best->missing * 5 < best->count : evidence <= 0)
            break;
        Camera bent;
        bend_camera(camera, EQUIDISTANT, STRONG[k], &bent);
        status = label_through(model, &bent, image, options, until, findings);
        if (status > 0)
            status = free_lens(model, image, options, until, findings);
    }
    return status;
}

/* ---- tracking ---- */

/* Least distance that a dot may have moved since the frame before, px; large ones by their own diameter. */
static const double LEAST_MOVE_PX = 12;

/* Adds the findings of a window to those of the frame. */
static int append(Findings *all, Findings *part)
{
    Blob *blobs = realloc(all->blobs, (size_t)(all->blob_count + part->blob_count + 1) * sizeof *blobs);
    Finding *findings = realloc(all->findings, (size_t)(all->count + part->count + 1) * sizeof *findings);
    if (blobs)
        all->blobs = blobs;
    if (findings)
        all->findings = findings;
    if (!blobs || !findings)
        return NO_MEMORY;
    memcpy(blobs + all->blob_count, part->blobs, (size_t)part->blob_count * sizeof *blobs);
    for (int64_t i = 0; i < part->count; i++) {
        Finding *finding = part->findings + i;
        for (int64_t d = 0; finding->dots && d < finding->count + finding->dropped; d++)
            finding->blobs[d] += all->blob_count;
        findings[all->count++] = *finding;
    }
    all->blob_count += part->blob_count;
    part->count = 0;
    return 0;
}

/* Whether a finding has a dot of one of others. */
static int overlap(const Findings *all, const Findings *part)
{
    const Finding *finding = part->findings;
    for (int64_t i = 0; i < all->count; i++)
        for (int64_t a = 0; a < all->findings[i].count; a++)
            for (int64_t b = 0; b < finding->count; b++) {
                const double *one = all->blobs[all->findings[i].blobs[a]].center, *other = part->blobs[finding->blobs[b]].center;
                if (fabs(one[0] - other[0]) < 1 && fabs(one[1] - other[1]) < 1)
                    return 1;
            }
    return 0;
}

/* The window in which the dots of a body may be that was there in the frame before; 0 if there are fewer than four of them. */
static int window_of(const Layout *layout, const Camera *camera, const Image *image, const Pose *pose, int64_t *corner, Image *window,
                     double *smallest)
{
    double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    const double right = (double)image->width - 1, bottom = (double)image->height - 1;
    int64_t count = 0;
    *smallest = INFINITY;
    for (int64_t d = 0; d < layout->count; d++) {
        Outline drawn;
        double pixel[2];
        outline_of(layout->dots + d, layout->dots[d].xyz, pose, &drawn);
        if (!drawn.seen)
            continue;
        lens_pixel(camera, drawn.center, pixel, NULL);
        if (!(pixel[0] >= 0 && pixel[1] >= 0 && pixel[0] <= right && pixel[1] <= bottom))
            continue;
        const double wide = sqrt(drawn.shape[0]) * camera->fx, tall = sqrt(drawn.shape[2]) * camera->fy;
        const double longer = wide > tall ? wide : tall, margin = longer + (2 * longer > LEAST_MOVE_PX ? 2 * longer : LEAST_MOVE_PX) + 8;
        const double half[2] = {margin, margin};
        for (int a = 0; a < 2; a++) {
            low[a] = pixel[a] - half[a] < low[a] ? pixel[a] - half[a] : low[a];
            high[a] = pixel[a] + half[a] > high[a] ? pixel[a] + half[a] : high[a];
        }
        const double shorter = 2 * shorter_px(sqrt(camera->fx * camera->fy), drawn.shape);
        *smallest = shorter < *smallest ? shorter : *smallest;
        count++;
    }
    if (count < LEAST_DOTS)
        return 0;
    const int64_t left = low[0] > 0 ? (int64_t)low[0] : 0, top = low[1] > 0 ? (int64_t)low[1] : 0;
    const int64_t end = high[0] < right ? (int64_t)high[0] : (int64_t)right, foot = high[1] < bottom ? (int64_t)high[1] : (int64_t)bottom;
    corner[0] = left;
    corner[1] = top;
    *window = *image;
    window->rows += top * image->stride + left * (image->wide ? 2 : 1);
    window->width = end - left + 1;
    window->height = foot - top + 1;
    return window->width > 2 && window->height > 2;
}

/* Finds again what was found in the frame before, in windows around it; 1 if all of it is there, 0 if not, or NO_MEMORY. */
static int track(const Model *model, const Camera *camera, int calibrated, const Image *image, const Options *options,
                 const Track *tracks, int64_t count, Findings *findings)
{
    int tracked = 1, status = 0;
    for (int64_t k = 0; k < count && tracked && !status; k++) {
        Findings part = {0};
        Image window;
        Options window_options = *options;
        int64_t corner[2];
        double smallest;
        tracked = window_of(model->layouts + model->members[tracks[k].member].layout, camera, image, &tracks[k].pose, corner, &window,
                          &smallest);
        if (!tracked)
            break;
        window_options.copies = 1;
        part.blob_count = find_blobs(&window, fmax(0.7 * smallest, options->smallest), options->blobs, &part.blobs);
        status = part.blob_count < 0 ? NO_MEMORY : 0;
        if (status)
            break;
        for (int64_t b = 0; b < part.blob_count; b++) {
            part.blobs[b].center[0] += (double)corner[0];
            part.blobs[b].center[1] += (double)corner[1];
        }
        undo_lens(camera, part.blobs, NULL, part.blob_count);
        /* Others are looked for, too: it might be one of them. */
        status = (int)label_frame(model, camera, calibrated, image, &window_options, &part);
        for (int64_t i = 0; i < part.count; i++)
            if (part.findings[i].state != FOUND || part.findings[i].member != tracks[k].member) {
                free(part.findings[i].dots);
                free(part.findings[i].pixels);
                part.findings[i--] = part.findings[--part.count];
            }
        tracked = !status && part.count && 2 * part.findings[0].count >= tracks[k].count && !overlap(findings, &part);
        if (tracked)
            status = append(findings, &part);
        findings_free(&part);
    }
    return status ? status : tracked;
}

int64_t detect_frame(const Model *model, const Camera *camera, int calibrated, const Image *image, const Options *options,
                     const Track *tracks, int64_t track_count, Findings *findings)
{
    memset(findings, 0, sizeof *findings);
    if (track_count) {
        const int tracked = track(model, camera, calibrated, image, options, tracks, track_count, findings);
        if (tracked)
            findings->tracked = tracked > 0;
        if (tracked)
            return tracked < 0 ? tracked : 0;
        findings_free(findings);
    }
    findings->blob_count = find_blobs(image, options->smallest, options->blobs, &findings->blobs);
    if (findings->blob_count < 0)
        return NO_MEMORY;
    undo_lens(camera, findings->blobs, NULL, findings->blob_count);
    return label_frame(model, camera, calibrated, image, options, findings);
}

void findings_free(Findings *findings)
{
    for (int64_t i = 0; i < findings->count; i++) {
        free(findings->findings[i].dots);
        free(findings->findings[i].pixels);
    }
    free(findings->findings);
    free(findings->blobs);
    memset(findings, 0, sizeof *findings);
}
