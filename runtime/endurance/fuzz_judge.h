/* fuzz_judge.h: what a step of a filter may not do, and where it did, for fuzz_target.c. Hand-written; the includer
 * names the struct (CORE_STATE) and its sizes (N_STATES, PACKED, THETA), and holds the counters of coverage. */

/* Bits that say nothing of the tuning. */
#define HARMLESS (PMSM_NOT_CONVERGED | PMSM_COMMAND_REJECTED)

/* Bits that excuse a covariance of any kind: an iteration that ran away leaves what the next step finds and restarts. */
#define EXCUSES (PMSM_RESTARTED | PMSM_NOT_CONVERGED)

/* The verdict on a step; 0 is good. `word` says where. "Unsaid": without PMSM_RESTARTED, after which the state is x_0
 * and P_0, whatever these are; LD: without an excuse; Q and R: without any bit that is not harmless. */
enum {
    GOOD,
    STATE_NOT_FINITE,      /* x, unsaid */
    COVARIANCE_NOT_FINITE, /* LD, unsaid; with Q or R other than the header asks: twice in a row */
    ANGLE_OUTSIDE,         /* theta not in [-pi, pi), unsaid */
    PIVOT_NEGATIVE,        /* an entry of D, unsaid, although Q and R are such as the header asks; 0 is underflow */
    TUNING_ACCEPTED,       /* Q or R not finite, unsaid, and P is not broken by it either */
    ITERATIONS_OUTSIDE,    /* more passes than asked for */
    DUTY_OUTSIDE,          /* controller: a duty cycle not in [0, 1], whatever the status */
    LANES_DIFFER,          /* the lane form has other bits or another status */
    KINDS
};

typedef struct {
    int kind;
    int word;
    int step;   /* counted from 1 */
    int status; /* of the last step */
} fuzz_verdict;

static int finite(float32 v)
{
    uint32_t bits;
    memcpy(&bits, &v, 4);
    return (bits & 0x7F800000u) != 0x7F800000u;
}

/* By size, without arithmetic: 0, denormal, tiny, small, ordinary, large, huge, infinite, NaN. */
static int size_class(float32 v)
{
    static const uint32_t edges[] = {0x00000001u, 0x00800000u, 0x21000000u, 0x36000000u, 0x49800000u, 0x5E000000u,
        0x7F800000u, 0x7F800001u};
    uint32_t bits;
    int k = 0;
    memcpy(&bits, &v, 4);
    bits &= 0x7FFFFFFFu;
    while (k < 8 && bits >= edges[k]) {
        k++;
    }
    return k;
}

static void feel(const CORE_STATE *c, int status)
{
    int i;
    for (i = 0; i < N_STATES + PACKED; i++) {
        const float32 v = (i < N_STATES) ? c->x[i] : c->LD[i - N_STATES];
        features[(i * 2 + ((v < 0.0f) ? 1 : 0)) * CLASSES + size_class(v)] = 1;
    }
    features[(N_STATES + PACKED) * 2 * CLASSES + (status & 63)] = 1;
    features[FEATURES - 4 + (c->iterations & 3)] = 1;
}

static void report(fuzz_verdict *v, int kind, int word)
{
    if (v->kind == GOOD) {
        v->kind = kind;
        v->word = word;
    }
}

static float32 variance(const CORE_STATE *c, int i)
{
    return (i < N_STATES) ? c->Q[i] : c->R[i - N_STATES];
}

static void judge_tuning(const CORE_STATE *before, fuzz_verdict *v)
{
    int i;
    for (i = 0; i < N_STATES + 2; i++) {
        if (finite(variance(before, i)) == 0) {
            report(v, TUNING_ACCEPTED, i);
        }
    }
}

static void judge_state(const CORE_STATE *c, fuzz_verdict *v)
{
    int i;
    for (i = 0; i < N_STATES; i++) {
        if (finite(c->x[i]) == 0) {
            report(v, STATE_NOT_FINITE, i);
        }
    }
    if (!(c->x[THETA] >= -3.14159274f && c->x[THETA] < 3.14159274f)) {
        report(v, ANGLE_OUTSIDE, THETA);
    }
}

static int first_not_finite(const CORE_STATE *c)
{
    int i = 0;
    while (i < PACKED && finite(c->LD[i]) != 0) {
        i++;
    }
    return i;
}

/* Where Q and R are not such as the header asks, P may be no number for one step: the next must say so. */
static void judge_covariance(const CORE_STATE *before, const CORE_STATE *c, fuzz_verdict *v)
{
    const int bad = first_not_finite(c);
    int asked = 1;
    int i;
    for (i = 0; i < N_STATES + 2; i++) {
        asked = asked && variance(c, i) >= 1e-18f && variance(c, i) <= 1e18f;
    }
    if (bad < PACKED && (asked || first_not_finite(before) < PACKED)) {
        report(v, COVARIANCE_NOT_FINITE, bad);
    }
    if (!asked) {
        return;
    }
    for (i = 0; i < N_STATES; i++) {
        if (!(c->LD[i * (i + 3) / 2] >= 0.0f)) {
            report(v, PIVOT_NEGATIVE, i);
        }
    }
}
