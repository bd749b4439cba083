#pragma once
#include <filesystem>
#include <vector>

#include "systems/app/capture_replay.hpp"
namespace trocar {

// One line a pass: what it cost, found and hashed to.
std::string capture_csv(const Capture& capture);
// The stages of every pass one after the other, as Chrome trace events: how long each took, not when it ran beside others.
std::string capture_trace(const Capture& capture);
// Per vertex of a body: mean over its springs that are whole (of a skin: those of the node under it) of |length / rest length - 1|;
// zeros for rigid bodies.
std::vector<float> vertex_strain(const World& world, uint32_t body);
// Runs the capture again and writes all bodies after every pass as bodies_PASS.vtp with point fields body (row in bodies.csv, which has
// the names), velocity (m/s), depth (m, of vertices inside another body as the pass began), contact (1 on vertices that had a contact
// then), strain and stress (Pa: mean over the springs of a vertex of their relative stretch, the same times Young's modulus), and
// bodies.pvd, a series that ParaView opens, by the time at the end of the pass. A body that is away (come and go) is not in its file.
// per_body: BODY_PASS.vtp and BODY.pvd for each instead, with materials and texture coordinates. Throws InputError.
void export_vtp(const Capture& capture, const std::filesystem::path& folder, bool per_body);
// Runs the capture again and draws every picture it takes: frames/*.png. Returns how many.
size_t export_pictures(const Capture& capture, const std::filesystem::path& folder);

}  // namespace trocar
