/* The steps of a simulation; outputs are computed twice each, as in loops of blocks. */
#include <string.h>

int simulate(int samples, const double *rows, double *results)
{
    SimStruct block, *S = &block;
    int i, k, port;
    memset(S, 0, sizeof block);
    mdlInitializeSizes(S);
    mdlInitializeSampleTimes(S);
    if (S->inputs != 3 || S->work > 64) {
        return -1;
    }
#ifdef MDL_INITIALIZE_CONDITIONS
    memset(S->memory, 255, sizeof S->memory);
    mdlInitializeConditions(S);
#endif
    for (i = 0; i < samples; ++i) {
        for (port = 0; port < 3; ++port) {
            for (k = 0; k < S->sizes[port]; ++k) {
                S->in[port][k] = *rows++;
            }
        }
        mdlOutputs(S, 0);
        mdlOutputs(S, 0);
        for (port = 0; port < S->outputs; ++port) {
            for (k = 0; k < S->widths[port]; ++k) {
                *results++ = S->out[port][k];
            }
        }
#ifdef MDL_UPDATE
        mdlUpdate(S, 0);
#endif
    }
    mdlTerminate(S);
    return S->outputs;
}
