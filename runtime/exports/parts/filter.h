/* The filter alone, as a part. Hand-written. FILTER names it. */
typedef struct {
    float32 u[2]; /* V: mean over the interval that ends now */
    float32 y[2]; /* A, now */
    int status;
    JOIN(FILTER, _t) filter;
} part_t;

static void part_init(part_t *p)
{
    memset(p, 0, sizeof *p);
    JOIN(FILTER, _init)(&p->filter);
}

/* The tuning is set: the first estimate is its own. */
static void part_begin(part_t *p)
{
    JOIN(FILTER, _reset)(&p->filter);
}

static void part_step(part_t *p)
{
    p->status = JOIN(FILTER, _step)(&p->filter, p->u, p->y);
}
