/* simulated_board.c: a board made of this machine, with a motor behind it. The generated commissioning C, unchanged,
 * behind standard input and output. Hand-written.
 * Arguments are name=value: the fields of motor_t, and seed, baud, delay, limit_current, limit_speed, limit_seconds, and
 * report: a file for the largest current, the fastest speed, and angle and speed now, whenever it comes to rest.
 * Time is the motor's: it passes as fast as this machine computes, and the line is as slow in it as a real one. */
#define _POSIX_C_SOURCE 200809L
#include "pmsm_commission.h"
#include "simulated_motor.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define FIFO 16 /* bytes of the transmitter */
#define HELD 50 /* samples after which they are handed on: not each byte by itself */

static unsigned char received[256], sending[4096];
static int received_count, received_at, sending_count, fifo;
static double credit; /* bytes that the line may carry by now */

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
    const int room = fifo < FIFO && sending_count < (int)sizeof sending;
    if (room) {
        sending[sending_count++] = (unsigned char)byte;
        fifo++;
    }
    return room;
}

Uint32 pmsm_board_ticks(void)
{
    return 0;
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

static const char *text_of(int count, char **words, const char *name)
{
    const size_t length = strlen(name);
    int k;
    for (k = 1; k < count; k++) {
        if (strncmp(words[k], name, length) == 0 && words[k][length] == '=') {
            return words[k] + length + 1;
        }
    }
    return NULL;
}

static double number(int count, char **words, const char *name, double otherwise)
{
    const char *text = text_of(count, words, name);
    return text ? strtod(text, NULL) : otherwise;
}

/* What the tests ask of the motor: it must not have been driven beyond its limits. */
static void tell_extremes(const char *path, const motor_t *m)
{
    FILE *file = path ? fopen(path, "w") : NULL;
    if (file) {
        fprintf(file, "%.9g %.9g %.9g %.9g\n", m->largest, m->fastest, m->theta, m->omega);
        fclose(file);
    }
}

static void read_motor(motor_t *m, int count, char **words)
{
#define READ(name) m->name = number(count, words, #name, 0.0)
    READ(R);
    READ(L_d);
    READ(L_q);
    READ(psi_m);
    READ(pole_pairs);
    READ(J);
    READ(D);
    READ(dry);
    READ(dc_link);
    READ(T);
    READ(dead_time);
    READ(drop);
    READ(range);
    READ(bits);
    READ(noise);
    READ(offset_a);
    READ(offset_b);
    READ(theta);
#undef READ
}

int main(int count, char **words)
{
    static pmsm_commission_t c;
    static motor_t m;
    const double baud = number(count, words, "baud", 115200.0);
    const int delay = (int)number(count, words, "delay", 1.0);
    const pmsm_commission_limits_t limits = {(float32)number(count, words, "limit_current", 1.0),
                                             (float32)number(count, words, "limit_speed", 1000.0),
                                             (float32)number(count, words, "limit_seconds", 120.0)};
    float duty[3] = {0.5f, 0.5f, 0.5f}, next[3] = {0.5f, 0.5f, 0.5f};
    int gates = 0, gates_next = 0, quiet = 0, held = 0;
    const char *report = text_of(count, words, "report");
    fcntl(0, F_SETFL, fcntl(0, F_GETFL) | O_NONBLOCK);
    read_motor(&m, count, words);
    motor_init(&m, (unsigned long long)number(count, words, "seed", 1.0));
    pmsm_commission_init(&c, (float32)m.T, delay, &limits);
    for (;;) {
        float phase[2], computed[3];
        const int before = sending_count;
        int on;
        motor_sense(&m, phase);
        on = pmsm_commission_step(&c, phase, (float)m.dc_link, computed);
        if (delay) {
            gates = gates_next;
            memcpy(duty, next, sizeof duty);
            gates_next = on;
            memcpy(next, computed, sizeof next);
            gates = gates && on; /* off is at once */
        } else {
            gates = on;
            memcpy(duty, computed, sizeof duty);
        }
        if (gates) {
            motor_switch(&m, duty);
        } else {
            motor_freewheel(&m);
        }
        credit += baud * m.T / 10.0;
        credit = credit > fifo + 1.0 ? fifo + 1.0 : credit;
        while (fifo > 0 && credit >= 1.0) {
            fifo--;
            credit -= 1.0;
        }
        pmsm_commission_poll(&c);
        quiet = (sending_count == before && c.state != PMSM_COMMISSION_RUNNING && fifo == 0) ? quiet + 1 : 0;
        held = (sending_count > 0) ? held + 1 : 0;
        if (held > HELD) {
            send_out();
            held = 0;
        }
        if (quiet > 100 && received_at == received_count) {
            struct pollfd bytes = {0, POLLIN, 0};
            tell_extremes(report, &m);
            poll(&bytes, 1, 1000);
        }
    }
}
