#pragma once
#include "components/bodies.hpp"
#include "components/particles.hpp"
#include "components/springs.hpp"
#include "components/tears.hpp"
#include "engine/spring_kernels.hpp"
namespace trocar {

// What the kernels need to read one deformable body as it stands: its springs, its anchors with goals at their rest
// positions, its offsets and velocities. Nothing to write to, no time, no gravity, no drag. With `torn`, the springs that
// are left.
SpringStep bind_body(const Springs& springs, const Bodies& bodies, const Anchors& anchors, const Particles& particles,
                     uint32_t body, const TornSprings* torn = nullptr);

// Slices of a body that a kernel takes at once: the same cut for any number of threads, about 20 us.
inline constexpr uint32_t kSlicesPerChunk = 512;

}  // namespace trocar
