/* simulated_board.c: a board made of this machine. The generated bench C, unchanged, behind standard input and output.
 * Hand-written. FILTER names the generated filter, HEADER its pil header.
 * Argument "telemetry": sends samples of a turning current vector instead of answering pil. */
#define _POSIX_C_SOURCE 200809L
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include HEADER
#include "pmsm_telemetry.h"

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)

#define PERIOD 1e-3f /* s, of the telemetry */

static unsigned char received[256], sending[512];
static int received_count, received_at, sending_count;

static void hung_up(void)
{
    _exit(0);
}

int pmsm_board_get(void)
{
    if (received_at == received_count) {
        const ssize_t count = read(0, received, sizeof received);
        if (count == 0 || (count < 0 && errno != EAGAIN && errno != EINTR)) {
            hung_up();
        }
        received_count = count > 0 ? (int)count : 0;
        received_at = 0;
    }
    return received_at < received_count ? received[received_at++] : -1;
}

int pmsm_board_put(Uint16 byte)
{
    const int room = sending_count < (int)sizeof sending;
    if (room) {
        sending[sending_count++] = (unsigned char)byte;
    }
    return room;
}

/* Nanoseconds. */
Uint32 pmsm_board_ticks(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (Uint32)((unsigned long)now.tv_sec * 1000000000uL + (unsigned long)now.tv_nsec);
}

static void send_out(void)
{
    int sent = 0;
    while (sent < sending_count) {
        const ssize_t count = write(1, sending + sent, (size_t)(sending_count - sent));
        if (count > 0) {
            sent += (int)count;
        } else if (errno != EAGAIN && errno != EINTR) {
            hung_up();
        } else {
            struct pollfd room = {1, POLLOUT, 0};
            poll(&room, 1, 100);
        }
    }
    sending_count = 0;
}

static void run_pil(void)
{
    static pmsm_pil_t pil;
    static JOIN(FILTER, _t) filter;
    JOIN(FILTER, _pil_init)(&pil, &filter);
    for (;;) {
        struct pollfd bytes = {0, POLLIN, 0};
        pmsm_pil_poll(&pil);
        send_out();
        if (received_at == received_count) {
            poll(&bytes, 1, 1000);
        }
    }
}

static void run_telemetry(void)
{
    static pmsm_telemetry_t telemetry;
    Uint32 sample;
    pmsm_telemetry_init(&telemetry, PERIOD);
    for (sample = 0;; sample++) {
        const struct timespec period = {0, (long)(PERIOD * 1e9f)};
        const float angle = 2.0f * (float)(sample % 100u) * 3.14159265f / 100.0f;
        const float u[2] = {10.0f * cosf(angle), 10.0f * sinf(angle)}, y[2] = {cosf(angle), sinf(angle)};
        pmsm_telemetry_send(&telemetry, sample, u, y, 15.0f, angle);
        pmsm_telemetry_poll(&telemetry);
        send_out();
        nanosleep(&period, NULL);
    }
}

int main(int count, char **arguments)
{
    fcntl(0, F_SETFL, fcntl(0, F_GETFL) | O_NONBLOCK);
    if (count > 1 && strcmp(arguments[1], "telemetry") == 0) {
        run_telemetry();
    } else {
        run_pil();
    }
    return 0;
}
