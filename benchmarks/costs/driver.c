/* driver.c: steps one filter over recorded inputs, to be counted by callgrind or to be compared.
 * HEADER names its header, FILTER its prefix. Arguments: number of steps, file of rows u, y as float, then anything
 * to print the state after every step. */
#include HEADER
#include <stdio.h>
#include <stdlib.h>

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)

int main(int argc, char **argv)
{
    JOIN(FILTER, _t) filter;
    const int steps = atoi(argv[1]);
    FILE *rows = fopen(argv[2], "rb");
    float row[4];
    int k, i;
    if (rows == NULL) {
        return 2;
    }
    JOIN(FILTER, _init)(&filter);
    for (k = 0; k < steps; k++) {
        if (fread(row, sizeof row, 1, rows) != 1) {
            return 3;
        }
        JOIN(FILTER, _step)(&filter, row, row + 2);
        for (i = 0; argc > 3 && i < (int)(sizeof filter.x / sizeof filter.x[0]); i++) {
            printf("%.9g ", (double)filter.x[i]);
        }
    }
    return fclose(rows);
}
