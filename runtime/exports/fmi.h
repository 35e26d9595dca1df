/* fmi.h: what FMI 2 and FMI 3 have in common. Hand-written, after the FMI specifications 2.0.5 and 3.0.2.
 *
 * The part (part_t, part_init, part_begin, part_step) and its table VARIABLES lie above. A step of the master is a whole
 * number of samples; inputs are held over it, and outputs are those of its last sample. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

/* Numbers of both standards. */
typedef enum { STATUS_OK = 0, STATUS_WARNING = 1, STATUS_DISCARD = 2, STATUS_ERROR = 3, STATUS_FATAL = 4 } status_t;

typedef enum { INSTANTIATED, INITIALIZING, STEPPING, TERMINATED } phase_t;

typedef struct {
    part_t part;
    phase_t phase;
    char name[128];
    void *environment;
    void *log; /* the master's function, or none */
    int logging;
} instance_t;

static void tell(const instance_t *instance, status_t status, const char *text); /* differs: FMI 2, FMI 3 */

static status_t refuse(const instance_t *instance, const char *form, ...)
{
    char text[256];
    va_list arguments;
    va_start(arguments, form);
    vsnprintf(text, sizeof text, form, arguments);
    va_end(arguments);
    tell(instance, STATUS_ERROR, text);
    return STATUS_ERROR;
}

static instance_t *new_instance(const char *name, const char *token, void *environment, void *log, int logging)
{
    instance_t *instance = (instance_t *)calloc(1, sizeof *instance);
    if (!instance) {
        return NULL;
    }
    snprintf(instance->name, sizeof instance->name, "%s", name ? name : "");
    instance->environment = environment;
    instance->log = log;
    instance->logging = logging;
    if (!token || strcmp(token, TOKEN) != 0) {
        (void)refuse(instance, "this is the FMU of another model description: its token differs");
        free(instance);
        return NULL;
    }
    part_init(&instance->part);
    return instance;
}

static void start_over(instance_t *instance)
{
    part_init(&instance->part);
    instance->phase = INSTANTIATED;
}

static status_t enter_initialization(instance_t *instance)
{
    if (instance->phase != INSTANTIATED) {
        return refuse(instance, "initialization was entered before");
    }
    instance->phase = INITIALIZING;
    return STATUS_OK;
}

static status_t exit_initialization(instance_t *instance)
{
    if (instance->phase != INITIALIZING) {
        return refuse(instance, "initialization was not entered");
    }
    part_begin(&instance->part);
    instance->phase = STEPPING;
    return STATUS_OK;
}

static status_t terminate(instance_t *instance)
{
    if (instance->phase != STEPPING) {
        return refuse(instance, "there is no simulation to terminate");
    }
    instance->phase = TERMINATED;
    return STATUS_OK;
}

/* The variable of a reference, where it has this type; else none. */
static const variable_t *variable_of(const instance_t *instance, unsigned reference, type_t type)
{
    if (reference >= VARIABLE_COUNT || VARIABLES[reference].type != type) {
        (void)refuse(instance, "there is no variable %u of this type", reference);
        return NULL;
    }
    return &VARIABLES[reference];
}

static void *place_of(instance_t *instance, const variable_t *variable)
{
    return (char *)&instance->part + variable->offset;
}

/* Whether a variable may be set now. */
static int settable(const instance_t *instance, const variable_t *variable)
{
    const int before = instance->phase == INSTANTIATED || instance->phase == INITIALIZING;
    if (variable->role == INPUT || variable->role == TUNABLE || (variable->role == FIXED && before)) {
        return 1;
    }
    (void)refuse(instance, "variable %u is %s", (unsigned)(variable - VARIABLES),
                 variable->role == FIXED ? "fixed: set it before the simulation" : "an output");
    return 0;
}

/* Samples from one communication point to the next. */
static status_t advance_part(instance_t *instance, double length)
{
    const double samples = length / SAMPLE_TIME;
    const double whole = floor(samples + 0.5);
    double k;
    if (instance->phase != STEPPING) {
        return refuse(instance, "a step before initialization, or after the end");
    }
    if (!(whole >= 1.0) || fabs(samples - whole) > 1e-6 * whole) {
        return refuse(instance, "a step of %g s is no whole number of samples of %g s", length, (double)SAMPLE_TIME);
    }
    for (k = 0.0; k < whole; k += 1.0) {
        part_step(&instance->part);
    }
    return STATUS_OK;
}

/* All that the next step depends on. */
static part_t *copy_part(const instance_t *instance)
{
    part_t *copy = (part_t *)malloc(sizeof *copy);
    if (copy) {
        *copy = instance->part;
    }
    return copy;
}
