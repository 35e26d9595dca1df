/* The commissioning C with its line and its sensors in a test's hands: a shared library. */
#include "pmsm_commission.h"

#include <stdlib.h>

static unsigned char from_host[4096], to_host[1 << 20];
static int from_count, from_at, to_count, room = 1;

int pmsm_board_get(void)
{
    return from_at < from_count ? from_host[from_at++] : -1;
}

int pmsm_board_put(Uint16 byte)
{
    if (room && to_count < (int)sizeof to_host) {
        to_host[to_count++] = (unsigned char)byte;
        return 1;
    }
    return 0;
}

Uint32 pmsm_board_ticks(void)
{
    return 0;
}

pmsm_commission_t *bench_new(float period, int delay, float current, float speed, float seconds)
{
    pmsm_commission_t *c = malloc(sizeof *c);
    const pmsm_commission_limits_t limits = {current, speed, seconds};
    from_count = from_at = to_count = 0;
    room = 1;
    pmsm_commission_init(c, period, delay, &limits);
    return c;
}

void bench_line(int open)
{
    room = open;
}

void bench_send(const unsigned char *bytes, int count)
{
    int k;
    from_count = from_at = 0;
    for (k = 0; k < count; k++) {
        from_host[from_count++] = bytes[k];
    }
}

int bench_unread(void)
{
    return from_count - from_at;
}

int bench_received(unsigned char *bytes)
{
    const int count = to_count;
    int k;
    for (k = 0; k < count; k++) {
        bytes[k] = to_host[k];
    }
    to_count = 0;
    return count;
}

int bench_state(const pmsm_commission_t *c)
{
    return c->state;
}

int bench_reason(const pmsm_commission_t *c)
{
    return c->reason;
}

int bench_segment(const pmsm_commission_t *c)
{
    return c->segment;
}
