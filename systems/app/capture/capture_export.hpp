#pragma once
#include <filesystem>
#include <vector>

#include "systems/app/capture/capture_replay.hpp"
namespace trocar {

// CSV with one line per pass: cost, findings and state hash.
std::string capture_csv(const Capture& capture);
// The stages of every pass as Chrome trace events, one after the other: shows durations, not concurrency.
std::string capture_trace(const Capture& capture);
// Strain per vertex of a body: mean of |length / rest length - 1| over its unbroken springs (for an embedded
// surface: over the springs of its dominant particle); zero for rigid bodies.
std::vector<float> vertex_strain(const World& world, uint32_t body);
// Replays the capture and writes all bodies after every pass as bodies_PASS.vtp, plus the time series
// bodies.pvd for ParaView (time at the end of each pass). Point fields: body (row in bodies.csv, which has
// the names), velocity (m/s), depth (m, of vertices inside another body at the start of the pass), contact (1
// where the vertex had a contact then), strain (mean relative stretch of the vertex's springs) and stress
// (Pa, strain times Young's modulus). Inactive pool bodies have no file. With per_body: BODY_PASS.vtp and
// BODY.pvd for each body, with materials and texture coordinates. Throws InputError.
void export_vtp(const Capture& capture, const std::filesystem::path& folder, bool per_body);
// Replays the capture into a page with the 3D player of every pass, with the times that were recorded. Throws InputError.
std::string capture_page(const Capture& capture);
// Replays the capture and draws its pictures as frames/*.png. Returns their number.
size_t export_pictures(const Capture& capture, const std::filesystem::path& folder);

}  // namespace trocar
