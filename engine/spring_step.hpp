#pragma once
#include "components/bodies.hpp"
#include "components/particles.hpp"
#include "components/springs.hpp"
#include "components/tears.hpp"
#include "engine/parallel.hpp"
#include "engine/spring_kernels.hpp"
namespace trocar {

// What the kernels need to read one deformable body as it stands: its springs, its anchors with goals at their rest
// positions, its offsets and velocities. Nothing to write to, no time, no gravity, no drag. With `torn`, the springs that
// are left.
SpringStep bind_body(const Springs& springs, const Bodies& bodies, const Anchors& anchors, const Particles& particles,
                     uint32_t body, const TornSprings* torn = nullptr);

// Slices of a body that a kernel takes at once: the same cut for any number of threads, about 3 us; a body of 10,000
// particles is then eight equal shares.
inline constexpr uint32_t kSlicesPerChunk = 80;

// Bodies of fewer chunks, 7,700 particles, are not worth the threads' meeting.
inline constexpr uint32_t kLeastShared = 7;

// Runs body(begin, end) over the slices of a body, chunk by chunk.
template <typename Body>  // Body: void(uint32_t begin, uint32_t end)
void for_slices(uint32_t slices, const Body& body) {
    parallel_for_even(slices, kSlicesPerChunk, kLeastShared, body);
}

}  // namespace trocar
