/* How a haptic device is joined to Trocar without changing it: a shared library that exports one function,
 *
 *     const trocar_device_api* trocar_device(void);
 *
 * and is named to the program as plugin:FILE?OPTIONS. Plain C, no library needed. Units are SI; the frame is the
 * device's own, right-handed. docs/example_device.c is a whole one. */
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
    double velocity[3];    /* m/s, as little late as can be: contact is damped by it. What is foretold is made from
                              positions. 0 if unknown; a sample of more than 7 m/s is refused */
    double grip;           /* rad, 0 = closed or none */
    uint32_t buttons;      /* one bit each */
    uint32_t reserved;     /* 0 */
} trocar_device_state;

/* A force field around a place: force(x) = force - stiffness (x - at). A device that only takes forces uses `force`. */
typedef struct trocar_device_command {
    double force[3];     /* N, on the hand */
    double torque[3];    /* N m */
    double at[3];        /* m */
    double stiffness[9]; /* N/m, row by row */
} trocar_device_command;

typedef enum trocar_exchange {
    TROCAR_NEW = 0,  /* `state` was filled */
    TROCAR_NONE = 1, /* nothing new */
    TROCAR_GONE = 2  /* the device is lost: it is closed, and opened again every half second */
} trocar_exchange;

/* Threads: the first open is called by the program's main thread; exchange, close and every later open by one thread of
 * the device's own. No two calls for one device overlap; several devices of one library have a thread each, and their
 * calls do overlap. */
typedef struct trocar_device_api {
    uint32_t version; /* TROCAR_DEVICE_VERSION */
    const char* name;
    /* Returns the device, or NULL and one line of reason (with its zero) in `error`. `options` is never NULL. */
    void* (*open)(const char* options, char* error, size_t error_size);
    /* Applies a command and fills the newest state. Called about 1000 times a second: it may wait for the device, but not
     * longer than a millisecond. While it does not come back the hand feels nothing after 13 ms, and a second after the
     * run it is left behind. With no force wanted, or when the simulation stopped, the command is all zero. */
    trocar_exchange (*exchange)(void* device, const trocar_device_command* command, trocar_device_state* state);
    void (*close)(void* device);
} trocar_device_api;

const trocar_device_api* trocar_device(void);

#ifdef __cplusplus
}
#endif
#endif
