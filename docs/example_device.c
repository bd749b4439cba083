/* A whole device for Trocar, around a motor that is only imagined here. Build and try:
 *
 *     cc -std=c11 -shared -fPIC -I components docs/example_device.c -o example_device.so
 *     trocar device test plugin:./example_device.so?mass=0.2
 *
 * Replace `step` by what your vendor's library offers: set the force, get the place. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "trocar_device.h"

typedef struct {
    double mass, time;
    double x[3], v[3];
} Puck;

static void* puck_open(const char* options, char* error, size_t error_size) {
    double mass = 0.1;
    if (*options && (sscanf(options, "mass=%lf", &mass) != 1 || !(mass > 0))) {
        snprintf(error, error_size, "\"%s\": write mass=KILOGRAMS", options);
        return NULL;
    }
    Puck* puck = calloc(1, sizeof *puck);
    if (!puck) {
        snprintf(error, error_size, "no memory");
        return NULL;
    }
    puck->mass = mass;
    return puck;
}

/* One millisecond of a puck that slides on a film of oil. */
static void step(Puck* puck, const double force[3]) {
    const double dt = 1e-3, oil = 2.0; /* s, N s/m */
    for (int k = 0; k < 3; ++k) {
        puck->v[k] += dt / puck->mass * (force[k] - oil * puck->v[k]);
        puck->x[k] += dt * puck->v[k];
    }
    puck->time += dt;
}

static trocar_exchange puck_exchange(void* device, const trocar_device_command* command, trocar_device_state* state) {
    Puck* puck = device;
    step(puck, command->force);
    state->time = puck->time;
    memcpy(state->position, puck->x, sizeof puck->x);
    memcpy(state->velocity, puck->v, sizeof puck->v);
    state->orientation[0] = 1;
    state->buttons = 0;
    return TROCAR_NEW;
}

static void puck_close(void* device) { free(device); }

const trocar_device_api* trocar_device(void) {
    static const trocar_device_api api = {TROCAR_DEVICE_VERSION, "puck", puck_open, puck_exchange, puck_close};
    return &api;
}
