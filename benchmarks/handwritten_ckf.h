/* handwritten_ckf.h: the filter of paper_spmsm as one would write it by hand, to measure the generated ones against. */
#ifndef HANDWRITTEN_CKF_H
#define HANDWRITTEN_CKF_H

#include "pmsm_port.h"

typedef struct {
    float32 x[4];  /* i_alpha A, i_beta A, omega rad/s mechanical, theta rad electrical */
    float32 P[16]; /* covariance of x, row by row */
    float32 Q[4];
    float32 R[2];
    float32 tolerance;  /* eps of (33) */
    int max_iterations; /* N_max; 1 makes it the CKF */
} handwritten_ckf_t;

void handwritten_ckf_init(handwritten_ckf_t *f);
void handwritten_ckf_reset(handwritten_ckf_t *f);

/* One step: u in V, mean over the interval ending now; y in A, now. Returns the iterates made. */
int handwritten_ckf_step(handwritten_ckf_t *f, const float32 u[2], const float32 y[2]);

#endif
