/* fmi3.c: the part as an FMI 3.0 co-simulation. */
#include <stdbool.h>
#include <stdint.h>

typedef void (*log_t)(void *environment, int status, const char *category, const char *text);

static void tell(const instance_t *instance, status_t status, const char *text)
{
    if (instance->log) {
        ((log_t)instance->log)(instance->environment, (int)status, "logStatusError", text);
    }
}

EXPORT const char *fmi3GetVersion(void)
{
    return "3.0";
}

EXPORT status_t fmi3SetDebugLogging(void *c, bool on, size_t count, const char *const categories[])
{
    (void)count;
    (void)categories;
    ((instance_t *)c)->logging = on;
    return STATUS_OK;
}

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                         bool logging, bool event_mode, bool early_return,
                                         const uint32_t intermediate[], size_t intermediates, void *environment,
                                         log_t log, void *intermediate_update)
{
    (void)resources;
    (void)visible;
    (void)event_mode;
    (void)early_return;
    (void)intermediate;
    (void)intermediates;
    (void)intermediate_update;
    return new_instance(name, token, environment, (void *)log, logging);
}

EXPORT void *fmi3InstantiateModelExchange(void)
{
    return NULL;
}

EXPORT void *fmi3InstantiateScheduledExecution(void)
{
    return NULL;
}

EXPORT void fmi3FreeInstance(void *c)
{
    free(c);
}

EXPORT status_t fmi3EnterInitializationMode(void *c, bool has_tolerance, double tolerance, double start, bool has_stop,
                                            double stop)
{
    (void)has_tolerance;
    (void)tolerance;
    (void)start;
    (void)has_stop;
    (void)stop;
    return enter_initialization((instance_t *)c);
}

EXPORT status_t fmi3ExitInitializationMode(void *c)
{
    return exit_initialization((instance_t *)c);
}

EXPORT status_t fmi3Terminate(void *c)
{
    return terminate((instance_t *)c);
}

EXPORT status_t fmi3Reset(void *c)
{
    start_over((instance_t *)c);
    return STATUS_OK;
}

/* --- values ---------------------------------------------------------------------------------------------------- */

#define VALUES(NAME, TYPE, KIND)                                                                                    \
    EXPORT status_t fmi3Get##NAME(void *c, const uint32_t vr[], size_t count, TYPE values[], size_t room)           \
    {                                                                                                               \
        size_t k;                                                                                                   \
        if (room != count) {                                                                                        \
            return refuse((instance_t *)c, "every variable is one value");                                         \
        }                                                                                                           \
        for (k = 0; k < count; k++) {                                                                               \
            const variable_t *variable = variable_of((instance_t *)c, vr[k], KIND);                                 \
            if (!variable) {                                                                                        \
                return STATUS_ERROR;                                                                                \
            }                                                                                                       \
            values[k] = *(const TYPE *)place_of((instance_t *)c, variable);                                         \
        }                                                                                                           \
        return STATUS_OK;                                                                                           \
    }                                                                                                               \
    EXPORT status_t fmi3Set##NAME(void *c, const uint32_t vr[], size_t count, const TYPE values[], size_t given)    \
    {                                                                                                               \
        size_t k;                                                                                                   \
        if (given != count) {                                                                                       \
            return refuse((instance_t *)c, "every variable is one value");                                         \
        }                                                                                                           \
        for (k = 0; k < count; k++) {                                                                               \
            const variable_t *variable = variable_of((instance_t *)c, vr[k], KIND);                                 \
            if (!variable || !settable((instance_t *)c, variable)) {                                                \
                return STATUS_ERROR;                                                                                \
            }                                                                                                       \
            *(TYPE *)place_of((instance_t *)c, variable) = values[k];                                               \
        }                                                                                                           \
        return STATUS_OK;                                                                                           \
    }
VALUES(Float32, float, FLOAT32)
VALUES(Float64, double, FLOAT64)
VALUES(Int32, int32_t, INT32)

/* --- the state, to go back to -------------------------------------------------------------------------------- */

EXPORT status_t fmi3GetFMUState(void *c, void **state)
{
    if (*state) {
        *(part_t *)*state = ((instance_t *)c)->part;
    } else {
        *state = copy_part((instance_t *)c);
    }
    return *state ? STATUS_OK : refuse((instance_t *)c, "no memory");
}

EXPORT status_t fmi3SetFMUState(void *c, void *state)
{
    ((instance_t *)c)->part = *(const part_t *)state;
    return STATUS_OK;
}

EXPORT status_t fmi3FreeFMUState(void *c, void **state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return STATUS_OK;
}

EXPORT status_t fmi3SerializedFMUStateSize(void *c, void *state, size_t *size)
{
    (void)c;
    (void)state;
    *size = sizeof(part_t);
    return STATUS_OK;
}

EXPORT status_t fmi3SerializeFMUState(void *c, void *state, uint8_t bytes[], size_t size)
{
    if (size != sizeof(part_t)) {
        return refuse((instance_t *)c, "a state has %u bytes", (unsigned)sizeof(part_t));
    }
    memcpy(bytes, state, size);
    return STATUS_OK;
}

EXPORT status_t fmi3DeserializeFMUState(void *c, const uint8_t bytes[], size_t size, void **state)
{
    if (size != sizeof(part_t)) {
        return refuse((instance_t *)c, "a state has %u bytes", (unsigned)sizeof(part_t));
    }
    if (!*state) {
        *state = copy_part((instance_t *)c);
    }
    if (!*state) {
        return refuse((instance_t *)c, "no memory");
    }
    memcpy(*state, bytes, size);
    return STATUS_OK;
}

/* --- steps ----------------------------------------------------------------------------------------------------- */

EXPORT status_t fmi3DoStep(void *c, double time, double length, bool no_return, bool *event, bool *end, bool *early,
                           double *reached)
{
    const status_t status = advance_part((instance_t *)c, length);
    (void)no_return;
    *event = false;
    *end = false;
    *early = false;
    *reached = (status == STATUS_OK) ? time + length : time;
    return status;
}

/* --- what this model has none of ------------------------------------------------------------------------------- */

/* Every function must be there; a call is an error whatever its other arguments, which are not looked at. */
#define NONE(NAME)                                                      \
    EXPORT status_t fmi3##NAME(void *c)                                 \
    {                                                                   \
        return refuse((instance_t *)c, "fmi3" #NAME ": not provided");  \
    }
NONE(GetInt8)
NONE(GetUInt8)
NONE(GetInt16)
NONE(GetUInt16)
NONE(GetUInt32)
NONE(GetInt64)
NONE(GetUInt64)
NONE(GetBoolean)
NONE(GetString)
NONE(GetBinary)
NONE(GetClock)
NONE(SetInt8)
NONE(SetUInt8)
NONE(SetInt16)
NONE(SetUInt16)
NONE(SetUInt32)
NONE(SetInt64)
NONE(SetUInt64)
NONE(SetBoolean)
NONE(SetString)
NONE(SetBinary)
NONE(SetClock)
NONE(GetNumberOfVariableDependencies)
NONE(GetVariableDependencies)
NONE(GetDirectionalDerivative)
NONE(GetAdjointDerivative)
NONE(EnterConfigurationMode)
NONE(ExitConfigurationMode)
NONE(GetIntervalDecimal)
NONE(GetIntervalFraction)
NONE(GetShiftDecimal)
NONE(GetShiftFraction)
NONE(SetIntervalDecimal)
NONE(SetIntervalFraction)
NONE(SetShiftDecimal)
NONE(SetShiftFraction)
NONE(EnterEventMode)
NONE(EvaluateDiscreteStates)
NONE(UpdateDiscreteStates)
NONE(EnterStepMode)
NONE(EnterContinuousTimeMode)
NONE(CompletedIntegratorStep)
NONE(SetTime)
NONE(SetContinuousStates)
NONE(GetContinuousStateDerivatives)
NONE(GetEventIndicators)
NONE(GetContinuousStates)
NONE(GetNominalsOfContinuousStates)
NONE(GetNumberOfEventIndicators)
NONE(GetNumberOfContinuousStates)
NONE(GetOutputDerivatives)
NONE(ActivateModelPartition)
