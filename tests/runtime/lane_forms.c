/* Steps the scalar and the lane forms of controller and motor beside each other and counts what differs. */
#include HEADER_FOC_LANES
#include HEADER_PLANT
#include HEADER_PLANT_LANES
#include <string.h>

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)

int lane_count(void)
{
    return LANES;
}

void init_drives(JOIN(FOC, _t) *drives, int delay)
{
    int b;
    for (b = 0; b < LANES; b++) {
        JOIN(FOC, _init)(&drives[b], delay);
    }
}

static int differ(const float *scalar, const lanes *side_by_side, int count, int lane)
{
    int k, found = 0;
    for (k = 0; k < count; k++) {
        found += memcmp(&scalar[k], &side_by_side[k].of[lane], sizeof(float)) != 0;
    }
    return found;
}

/* phase, command, sensed: [steps][2][LANES]. Statuses that were met are or-ed into seen. */
int compare_controllers(JOIN(FOC, _t) *drives, int steps, const float *phase, const float *command,
                        const float *sensed, int *seen)
{
    JOIN(FOC, _lanes_t) group;
    int lane, k, j, found = 0;
    for (lane = 0; lane < LANES; lane++) {
        JOIN(FOC, _lanes_load)(&group, lane, &drives[lane]);
    }
    for (k = 0; k < steps; k++) {
        lanes in_phase[2], in_command[2], duties[3];
        for (j = 0; j < 2; j++) {
            memcpy(&in_phase[j], &phase[(2 * k + j) * LANES], sizeof(lanes));
            memcpy(&in_command[j], &command[(2 * k + j) * LANES], sizeof(lanes));
            memcpy(&group.sensed[j], &sensed[(2 * k + j) * LANES], sizeof(lanes));
        }
        JOIN(FOC, _lanes_step)(&group, in_phase, in_command, duties);
        for (lane = 0; lane < LANES; lane++) {
            JOIN(FOC, _t) *c = &drives[lane];
            float one[2], two[2], duty[3];
            int status;
            for (j = 0; j < 2; j++) {
                one[j] = in_phase[j].of[lane];
                two[j] = in_command[j].of[lane];
                c->sensed[j] = group.sensed[j].of[lane];
            }
            status = JOIN(FOC, _step)(c, one, two, duty);
            *seen |= status;
            found += status != group.status[lane];
            found += differ(duty, duties, 3, lane);
            found += differ(c->integrator, group.integrator, 4, lane);
            found += differ(c->v_acting, group.v_acting, 2, lane) + differ(c->v_queued, group.v_queued, 2, lane);
            found += differ(c->command_held, group.command_held, 2, lane);
            found += differ(c->filter.x, group.filter.x, sizeof(c->filter.x) / sizeof(float), lane);
            found += differ(c->filter.COVARIANCE, group.filter.COVARIANCE,
                            sizeof(c->filter.COVARIANCE) / sizeof(float), lane);
        }
    }
    return found;
}

/* motor [6][LANES], theta, load [LANES], v [steps][2][LANES]: every word of the state after each sample. */
int compare_motors(const double *motor, const double *theta, const double *load, const double *v, int steps, int n)
{
    lanes_f64 group[6], data[6], angle, torque_load;
    double scalar[LANES][6], own[LANES][6];
    int lane, k, j, found = 0;
    memcpy(data, motor, sizeof(data));
    memcpy(&angle, theta, sizeof(angle));
    memcpy(&torque_load, load, sizeof(torque_load));
    JOIN(PLANT, _lanes_rest)(data, &angle, group);
    for (lane = 0; lane < LANES; lane++) {
        for (j = 0; j < 6; j++) {
            own[lane][j] = data[j].of[lane];
        }
        JOIN(PLANT, _rest)(own[lane], theta[lane], scalar[lane]);
    }
    for (k = 0; k <= steps; k++) {
        lanes_f64 i[2], torque[1], voltage[2];
        JOIN(PLANT, _lanes_outputs)(group, data, i, torque);
        for (lane = 0; lane < LANES; lane++) {
            double one[2], two[1];
            JOIN(PLANT, _outputs)(scalar[lane], own[lane], one, two);
            found += one[0] != i[0].of[lane] || one[1] != i[1].of[lane] || two[0] != torque[0].of[lane];
            for (j = 0; j < 6; j++) {
                found += scalar[lane][j] != group[j].of[lane];
            }
        }
        if (k == steps) {
            break;
        }
        memcpy(voltage, &v[2 * k * LANES], sizeof(voltage));
        JOIN(PLANT, _lanes_advance)(group, data, voltage, &torque_load, 12.5e-6, n);
        for (lane = 0; lane < LANES; lane++) {
            const double one[2] = {voltage[0].of[lane], voltage[1].of[lane]};
            JOIN(PLANT, _advance)(scalar[lane], own[lane], one, load[lane], 12.5e-6, n);
        }
    }
    return found;
}
