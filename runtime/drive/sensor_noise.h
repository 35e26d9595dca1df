/* sensor_noise.h: Gaussian noise of two current sensors, LANES runs at once. Hand-written.
 *
 * Counter-based: Philox4x32-10 (Salmon, Moraes, Dror, Shaw, Parallel Random Numbers: As Easy as 1, 2, 3, SC 2011), the
 * run's seed as key, the pair of samples as counter. So a run's noise depends on its seed alone, not on its lane, its
 * batch or who computes it. Normal by Box and Muller in float32: r = sqrt(-2 ln u), u a multiple of 2^-32 above 2^-33, so
 * the tails reach 6.7 sigma; logarithm, sine and cosine are arithmetic, with the same bits on every IEEE machine.
 * Loops over lanes hold no call and no branch: a compiler puts them into vector registers. */
#ifndef SENSOR_NOISE_H
#define SENSOR_NOISE_H

#include <stdint.h>
#include <string.h>

typedef struct {
    uint32_t of[LANES];
} noise_words;

/* Four words a lane: Philox4x32-10 of counter (pair, 0, 0, 0) under a 64-bit key. */
static void philox(const uint32_t *__restrict key_low, const uint32_t *__restrict key_high, uint32_t pair,
                   noise_words *__restrict words)
{
    int lane;
    for (lane = 0; lane < LANES; lane++) {
        uint32_t c0 = pair, c1 = 0, c2 = 0, c3 = 0;
        uint32_t k0 = key_low[lane], k1 = key_high[lane];
        int round;
#pragma GCC unroll 10
        for (round = 0; round < 10; round++) {
            const uint64_t p0 = (uint64_t)0xD2511F53u * c0;
            const uint64_t p1 = (uint64_t)0xCD9E8D57u * c2;
            c0 = (uint32_t)(p1 >> 32) ^ c1 ^ k0;
            c1 = (uint32_t)p1;
            c2 = (uint32_t)(p0 >> 32) ^ c3 ^ k1;
            c3 = (uint32_t)p0;
            k0 += 0x9E3779B9u;
            k1 += 0xBB67AE85u;
        }
        words[0].of[lane] = c0;
        words[1].of[lane] = c1;
        words[2].of[lane] = c2;
        words[3].of[lane] = c3;
    }
}

/* Two independent standard normals a lane from two words. */
static void box_muller(const noise_words *__restrict words, float *__restrict first, float *__restrict second)
{
    int lane;
    for (lane = 0; lane < LANES; lane++) {
        /* ln u, u = m 2^e with m in [sqrt(1/2), sqrt(2)): minimax polynomial of Cephes' logf (S. Moshier) */
        const float u = (float)words[0].of[lane] * 2.3283064365386963e-10f + 1.1641532182693481e-10f;
        uint32_t bits;
        memcpy(&bits, &u, sizeof(bits));
        const uint32_t shifted = bits - 0x3F3504F3u; /* sqrt(1/2) becomes the lower end */
        const int32_t e = (int32_t)shifted >> 23;
        const uint32_t mantissa = (shifted & 0x007FFFFFu) + 0x3F3504F3u;
        float m;
        memcpy(&m, &mantissa, sizeof(m));
        const float x = m - 1.0f;
        const float z = x * x;
        const float series = ((((((((7.0376836292e-2f * x - 1.1514610310e-1f) * x + 1.1676998740e-1f) * x -
            1.2420140846e-1f) * x + 1.4249322787e-1f) * x - 1.6668057665e-1f) * x + 2.0000714765e-1f) * x -
            2.4999993993e-1f) * x + 3.3333331174e-1f);
        const float tail = x * z * series + (float)e * -2.12194440e-4f - 0.5f * z;
        const float ln = x + tail + (float)e * 0.693359375f;
        const float ln_u = (ln < 0.0f) ? ln : 0.0f;
        const float radius = __builtin_sqrtf(-2.0f * ln_u);
        /* the other word as an angle: half turns, and what is left of |r| <= pi / 2; polynomials of codegen/trig.py */
        const uint32_t w = words[1].of[lane];
        const uint32_t half_turns = (w + 0x40000000u) >> 31;
        const float r = (float)(int32_t)(w - (half_turns << 31)) * 1.4629180792671596e-09f; /* 2 pi 2^-32 */
        const float sign = (half_turns != 0) ? -1.0f : 1.0f;
        const float q = r * r;
        const float sine = r + r * q * (((2.5999033e-06f * q + -0.00019806547f) * q + 0.008333016f) * q +
            -0.16666657f);
        const float cosine = 1.0f - 0.5f * q + q * q * (((-2.6192484e-07f * q + 2.476924e-05f) * q +
            -0.0013888568f) * q + 0.041666656f);
        first[lane] = radius * (sign * cosine);
        second[lane] = radius * (sign * sine);
    }
}

#endif
