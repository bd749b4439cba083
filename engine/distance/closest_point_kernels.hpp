#pragma once
#include <stdint.h>
namespace trocar {

// Up to 16 triangles over up to 32 shared vertices, in scaled local coordinates (see closest_point.cpp). 256
// bytes if it has at most 16 vertices; the last three arrays exist only in wide meshlets. Unused lanes repeat
// the last triangle, unused vertices the last vertex.
struct alignas(64) Meshlet {
    float x[16], y[16], z[16];
    uint8_t corner[3][16];  // index of a vertex of the meshlet
    float error_base;       // |float distance - distance| <= error_base + error_slope * distance + 2^-24 |query|
    float error_slope;
    uint16_t float_lanes;  // lanes for which the float kernel is accurate
    uint16_t exact_lanes;  // lanes to be evaluated in double
    uint16_t wide;
    uint16_t pad;
    float more_x[16], more_y[16], more_z[16];
};

struct MeshletMeasure {
    float size_term;         // max over accurate lanes of L (16 + 24 L^2 / 2A): L longest edge, A area
    float slenderness;       // max over accurate lanes of L^2 / 2A
    uint32_t slender_lanes;  // lanes with 2A < 1e-2 L^2, or too small for float
    float min[3], max[3];    // of the vertices
};

// Sets error_base, error_slope, float_lanes and exact_lanes from a measure; the derivation is in closest_point.cpp.
// False if a vertex is not finite: then no lane is trusted.
bool bound_error(Meshlet* meshlet, const MeshletMeasure* measure);

// One instruction set's versions of the kernels. All versions give the same bits.
struct MeshletKernels {
    // Writes the 16 squared distances from q and returns the least; mask gets the lanes below limit.
    float (*distance)(const Meshlet* meshlet, const float* q, float limit, float* squared, uint32_t* mask);
    void (*measure)(const Meshlet* meshlet, MeshletMeasure* measure);
    // Fills the vertices from arrays of four floats: (offset - centre) * scale.
    void (*fill)(Meshlet* meshlet, const float* offset, const uint32_t* vertex, const float* centre, float scale);
};

extern const MeshletKernels kMeshletKernelsAvx2;
extern const MeshletKernels kMeshletKernelsAvx512;

}  // namespace trocar
