/* fmi2.c: the part as an FMI 2.0 co-simulation slave. */
typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char *fmi2String;
typedef char fmi2Byte;
typedef int fmi2Status;

typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

static void tell(const instance_t *instance, status_t status, const char *text)
{
    if (instance->log) {
        ((const fmi2CallbackFunctions *)instance->log)
            ->logger(instance->environment, instance->name, (fmi2Status)status, "logStatusError", "%s", text);
    }
}

EXPORT const char *fmi2GetTypesPlatform(void)
{
    return "default";
}

EXPORT const char *fmi2GetVersion(void)
{
    return "2.0";
}

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count, const fmi2String categories[])
{
    (void)count;
    (void)categories;
    ((instance_t *)c)->logging = on;
    return STATUS_OK;
}

EXPORT fmi2Component fmi2Instantiate(fmi2String name, int type, fmi2String token, fmi2String resources,
                                     const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    void *environment = functions ? functions->componentEnvironment : NULL;
    void *log = (functions && functions->logger) ? (void *)(size_t)functions : NULL;
    (void)resources;
    (void)visible;
    if (type != 1) { /* fmi2CoSimulation */
        return NULL;
    }
    return new_instance(name, token, environment, log, logging);
}

EXPORT void fmi2FreeInstance(fmi2Component c)
{
    free(c);
}

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                                      fmi2Boolean has_stop, fmi2Real stop)
{
    (void)c;
    (void)has_tolerance;
    (void)tolerance;
    (void)start;
    (void)has_stop;
    (void)stop;
    return STATUS_OK;
}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    return enter_initialization((instance_t *)c);
}

EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    return exit_initialization((instance_t *)c);
}

EXPORT fmi2Status fmi2Terminate(fmi2Component c)
{
    return terminate((instance_t *)c);
}

EXPORT fmi2Status fmi2Reset(fmi2Component c)
{
    start_over((instance_t *)c);
    return STATUS_OK;
}

/* --- values: a Real is a float32 or a float64 of the part ---------------------------------------------------- */

EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count, fmi2Real value[])
{
    instance_t *instance = (instance_t *)c;
    size_t k;
    for (k = 0; k < count; k++) {
        const int single = vr[k] < VARIABLE_COUNT && VARIABLES[vr[k]].type == FLOAT32;
        const variable_t *variable = variable_of(instance, vr[k], single ? FLOAT32 : FLOAT64);
        if (!variable) {
            return STATUS_ERROR;
        }
        value[k] = single ? (double)*(const float *)place_of(instance, variable)
                          : *(const double *)place_of(instance, variable);
    }
    return STATUS_OK;
}

EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count, const fmi2Real value[])
{
    instance_t *instance = (instance_t *)c;
    size_t k;
    for (k = 0; k < count; k++) {
        const int single = vr[k] < VARIABLE_COUNT && VARIABLES[vr[k]].type == FLOAT32;
        const variable_t *variable = variable_of(instance, vr[k], single ? FLOAT32 : FLOAT64);
        if (!variable || !settable(instance, variable)) {
            return STATUS_ERROR;
        }
        if (single) {
            *(float *)place_of(instance, variable) = (float)value[k];
        } else {
            *(double *)place_of(instance, variable) = value[k];
        }
    }
    return STATUS_OK;
}

EXPORT fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t count, fmi2Integer value[])
{
    size_t k;
    for (k = 0; k < count; k++) {
        const variable_t *variable = variable_of((instance_t *)c, vr[k], INT32);
        if (!variable) {
            return STATUS_ERROR;
        }
        value[k] = *(const int *)place_of((instance_t *)c, variable);
    }
    return STATUS_OK;
}

EXPORT fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t count, const fmi2Integer value[])
{
    size_t k;
    for (k = 0; k < count; k++) {
        const variable_t *variable = variable_of((instance_t *)c, vr[k], INT32);
        if (!variable || !settable((instance_t *)c, variable)) {
            return STATUS_ERROR;
        }
        *(int *)place_of((instance_t *)c, variable) = value[k];
    }
    return STATUS_OK;
}

/* There are no variables of these types. */
#define NO_VALUES(NAME, TYPE)                                                                                      \
    EXPORT fmi2Status fmi2Get##NAME(fmi2Component c, const fmi2ValueReference vr[], size_t count, TYPE value[])      \
    {                                                                                                              \
        (void)vr;                                                                                                  \
        (void)value;                                                                                               \
        return count ? refuse((instance_t *)c, "there are no variables of type " #NAME) : STATUS_OK;               \
    }                                                                                                              \
    EXPORT fmi2Status fmi2Set##NAME(fmi2Component c, const fmi2ValueReference vr[], size_t count, const TYPE value[]) \
    {                                                                                                              \
        (void)vr;                                                                                                  \
        (void)value;                                                                                               \
        return count ? refuse((instance_t *)c, "there are no variables of type " #NAME) : STATUS_OK;               \
    }
NO_VALUES(Boolean, fmi2Boolean)
NO_VALUES(String, fmi2String)

/* --- the state, to go back to -------------------------------------------------------------------------------- */

EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    if (*state) {
        *(part_t *)*state = ((instance_t *)c)->part;
    } else {
        *state = copy_part((instance_t *)c);
    }
    return *state ? STATUS_OK : refuse((instance_t *)c, "no memory");
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    ((instance_t *)c)->part = *(const part_t *)state;
    return STATUS_OK;
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return STATUS_OK;
}

EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)c;
    (void)state;
    *size = sizeof(part_t);
    return STATUS_OK;
}

EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    if (size != sizeof(part_t)) {
        return refuse((instance_t *)c, "a state has %u bytes", (unsigned)sizeof(part_t));
    }
    memcpy(bytes, state, size);
    return STATUS_OK;
}

EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
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

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real length, fmi2Boolean no_return)
{
    (void)time;
    (void)no_return;
    return advance_part((instance_t *)c, length);
}

EXPORT fmi2Status fmi2CancelStep(fmi2Component c)
{
    return refuse((instance_t *)c, "steps are never pending");
}

EXPORT fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                               const fmi2ValueReference known[], size_t knowns, const fmi2Real seed[],
                                               fmi2Real value[])
{
    (void)unknown;
    (void)unknowns;
    (void)known;
    (void)knowns;
    (void)seed;
    (void)value;
    return refuse((instance_t *)c, "derivatives are not provided");
}

EXPORT fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                              const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr;
    (void)count;
    (void)order;
    (void)value;
    return refuse((instance_t *)c, "inputs are held over a step");
}

EXPORT fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                               const fmi2Integer order[], fmi2Real value[])
{
    (void)vr;
    (void)count;
    (void)order;
    (void)value;
    return refuse((instance_t *)c, "outputs have no derivatives");
}

/* A step ends before it returns: there is no status of a pending one. */
#define NO_STATUS(NAME, TYPE)                                                       \
    EXPORT fmi2Status fmi2Get##NAME(fmi2Component c, int kind, TYPE *value)         \
    {                                                                               \
        (void)c;                                                                    \
        (void)kind;                                                                 \
        (void)value;                                                                \
        return STATUS_DISCARD;                                                      \
    }
NO_STATUS(Status, fmi2Status)
NO_STATUS(RealStatus, fmi2Real)
NO_STATUS(IntegerStatus, fmi2Integer)
NO_STATUS(BooleanStatus, fmi2Boolean)
NO_STATUS(StringStatus, fmi2String)
