/* --- PLECS: what the sections of a C-Script block call ---------------------------------------------------------- */

/* A block has a copy of this file to itself, and so these two: the part as it is, and as it will be after this sample. */
static part_t now, next;

/* Change a value by its name before the first sample; 0: there is none of that name. */
static int block_set(const char *name, double value)
{
    unsigned k;
    for (k = 0; k < VARIABLE_COUNT; k++) {
        if (strcmp(NAMES[k], name) == 0 && VARIABLES[k].role != OUTPUT) {
            set_value(&now, k, value);
            return 1;
        }
    }
    return 0;
}

static void block_power_up(void)
{
    part_init(&now);
}

static void block_begin(void)
{
    part_begin(&now);
    next = now;
}

static void block_input(unsigned port, unsigned k, double value)
{
    set_value(&next, INPUTS[port].first + k, value);
}

/* Before the inputs of a sample. */
static void block_prepare(void)
{
    next = now;
}

static void block_step(void)
{
    part_step(&next);
}

static double block_output(unsigned port, unsigned k)
{
    return value_of(FEEDTHROUGH ? &next : &now, OUTPUTS[port].first + k);
}

static void block_accept(void)
{
    now = next;
}
