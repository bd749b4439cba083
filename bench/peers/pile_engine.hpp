#pragma once
// A heap of rigid boxes in another engine, behind plain functions: the adapter of an engine that Debian does not have is compiled when
// the bench runs, from the user's copy of the engine, and loaded.
#include <cstdint>

extern "C" {

struct PileBox {
    double half[3];         // m, half edges
    double position[3];     // m, of the middle
    double orientation[4];  // unit quaternion x y z w
    uint32_t free;          // 0: it does not move
};

struct PileSettings {
    double gravity[3];  // m/s^2
    double density;     // kg/m^3
    double friction;    // of every pair
    double step;        // s, of a call of PileEngine::step
    uint32_t substeps;  // in it
};

struct PileEngine {
    const char* settings;  // what was chosen, for the bench's note
    uint32_t substeps;     // that its authors recommend, or that others compare
    void* (*make)(const PileBox* box, uint32_t count, const PileSettings* settings);
    void (*step)(void* pile);
    void (*poses)(void* pile, double* pose);  // of every box in order: position, orientation, seven numbers
    void (*destroy)(void* pile);
};

// Of a loaded adapter.
PileEngine pile_engine();
}
