/* Interface for adding a haptic device to Trocar without changing it: a shared library that exports one function,
 *
 *     const trocar_device_api* trocar_device(void);
 *
 * selected in the program as plugin:FILE?OPTIONS. Plain C, no library needed. Units are SI; the frame is the
 * device's own, right-handed. docs/example_device.c is a complete example. */
#ifndef TROCAR_DEVICE_H
#define TROCAR_DEVICE_H
#include <stddef.h>
#include <stdint.h>
#ifdef __cplusplus
extern "C" {
#endif

#define TROCAR_DEVICE_VERSION 1u

typedef struct trocar_device_state {
    double time;           /* s, any clock that never goes back */
    double position[3];    /* m */
    double orientation[4]; /* unit quaternion w, x, y, z */
    double velocity[3];    /* m/s, with as little delay as possible: contact damping uses it. Extrapolation uses
                              positions instead. 0 if unknown; a sample above 7 m/s is rejected */
    double grip;           /* rad, 0 = closed or none */
    uint32_t buttons;      /* one bit each */
    uint32_t reserved;     /* 0 */
} trocar_device_state;

/* A force field around a point: force(x) = force - stiffness (x - at). A device that only takes forces uses `force`. */
typedef struct trocar_device_command {
    double force[3];     /* N, on the hand */
    double torque[3];    /* N m */
    double at[3];        /* m */
    double stiffness[9]; /* N/m, row-major */
} trocar_device_command;

typedef enum trocar_exchange {
    TROCAR_NEW = 0,  /* `state` was filled */
    TROCAR_NONE = 1, /* nothing new */
    TROCAR_GONE = 2  /* the device is lost: it is closed, and opened again every half second */
} trocar_exchange;

/* Threads: the program's main thread calls the first open; one thread per device calls exchange, close and every later
 * open. No two calls for one device overlap; several devices of one library have a thread each, and their calls do
 * overlap. */
typedef struct trocar_device_api {
    uint32_t version; /* TROCAR_DEVICE_VERSION */
    const char* name;
    /* Returns the device, or NULL and the reason, one zero-terminated line, in `error`. `options` is never NULL. */
    void* (*open)(const char* options, char* error, size_t error_size);
    /* Applies a command and fills in the newest state. Called about 1000 times a second: it may wait for the device, but
     * at most a millisecond. If it does not return, the hand feels no force after 13 ms, and the program abandons the
     * thread one second after the run. When no force is wanted, or the simulation has stopped, the command is all zero. */
    trocar_exchange (*exchange)(void* device, const trocar_device_command* command, trocar_device_state* state);
    void (*close)(void* device);
} trocar_device_api;

const trocar_device_api* trocar_device(void);

#ifdef __cplusplus
}
#endif
#endif
