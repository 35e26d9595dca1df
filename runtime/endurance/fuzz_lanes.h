/* fuzz_lanes.h: the lane form of the filter beside the scalar one, for fuzz_target.c. Hand-written.
 *
 * Every step of an input is noted: the filter before it, what went in, the filter after it. At the input's end as many
 * as there are lanes go through one step of the lane form, so that lanes that differ in everything stand side by side,
 * and each must have the scalar step's bits; a NaN may be any NaN. LANE_WORDS and LANE_INTEGERS list the fields of the
 * lane form's struct. */
#include LANES_HEADER

#define LANES_STATE JOIN(FILTER, _lanes_t)

typedef struct {
    STATE before;
    STATE after;
    float32 u[2];
    float32 y[2];
    int status;
} noted_step;

static noted_step noted[MOST_STEPS + 2];
static int count_noted;

/* Word i of the field at `at`, of a scalar struct. */
static void load_words(lanes *to, const STATE *from, size_t at, size_t length, int lane)
{
    size_t i;
    for (i = 0; i < length; i++) {
        memcpy(&to[i].of[lane], (const unsigned char *)from + at + 4U * i, 4);
    }
}

static int same_words(const lanes *found, const STATE *wanted, size_t at, size_t length, int lane)
{
    size_t i;
    for (i = 0; i < length; i++) {
        float32 w;
        memcpy(&w, (const unsigned char *)wanted + at + 4U * i, 4);
        if (memcmp(&w, &found[i].of[lane], 4) != 0 && !(w != w && found[i].of[lane] != found[i].of[lane])) {
            return 0;
        }
    }
    return 1;
}

#define LOAD_WORDS(name) load_words(g.name, &n->before, offsetof(STATE, name), LENGTH(g.name), lane);
#define LOAD_INTEGER(name) g.name[lane] = n->before.name;
#define SAME_WORDS(name) same &= same_words(g.name, &n->after, offsetof(STATE, name), LENGTH(g.name), lane);
#define SAME_INTEGER(name) same &= (g.name[lane] == n->after.name) ? 1 : 0;

/* The noted steps from `first` on, one lane each; lanes beyond the last repeat it. Returns how many differ. */
static int lanes_differ(int first)
{
    LANES_STATE g;
    lanes u[2], y[2];
    int lane, i;
    int differ = 0;
    for (lane = 0; lane < LANES; lane++) {
        const noted_step *n = &noted[(first + lane < count_noted) ? first + lane : count_noted - 1];
        LANE_WORDS(LOAD_WORDS)
        LANE_INTEGERS(LOAD_INTEGER)
        g.status[lane] = 0;
        for (i = 0; i < 2; i++) {
            u[i].of[lane] = n->u[i];
            y[i].of[lane] = n->y[i];
        }
    }
    JOIN(FILTER, _lanes_step)(&g, u, y);
    for (lane = 0; lane < LANES && first + lane < count_noted; lane++) {
        const noted_step *n = &noted[first + lane];
        int same = (g.status[lane] == n->status) ? 1 : 0;
        LANE_WORDS(SAME_WORDS)
        LANE_INTEGERS(SAME_INTEGER)
        differ += 1 - same;
    }
    return differ;
}

static void compare_lanes(fuzz_verdict *v)
{
    int first;
    for (first = 0; first < count_noted; first += LANES) {
        if (lanes_differ(first) != 0) {
            report(v, LANES_DIFFER, 0);
        }
    }
    count_noted = 0;
}
