/* Values of a part by their reference, as doubles. Hand-written. */
static double value_of(const part_t *part, unsigned reference)
{
    const char *place = (const char *)part + VARIABLES[reference].offset;
    switch (VARIABLES[reference].type) {
    case FLOAT32:
        return (double)*(const float *)place;
    case FLOAT64:
        return *(const double *)place;
    default:
        return (double)*(const int *)place;
    }
}

static void set_value(part_t *part, unsigned reference, double value)
{
    char *place = (char *)part + VARIABLES[reference].offset;
    switch (VARIABLES[reference].type) {
    case FLOAT32:
        *(float *)place = (float)value;
        break;
    case FLOAT64:
        *(double *)place = value;
        break;
    default:
        *(int *)place = (value > -2147483648.0 && value < 2147483648.0) ? (int)value : 0;
        break;
    }
}
