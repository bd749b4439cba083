#include "systems/frame.hpp"

#include <algorithm>
#include <string>

#include "engine/check.hpp"
#include "engine/thread_pool.hpp"
#include "systems/advance.hpp"
#include "systems/body_boxes.hpp"
#include "systems/candidate_cells.hpp"
#include "systems/candidate_pairs.hpp"
#include "systems/contact_rows.hpp"
#include "systems/deformable_energy.hpp"
#include "systems/device_input.hpp"
#include "systems/edge_pass.hpp"
#include "systems/haptic_tick.hpp"
#include "systems/islands.hpp"
#include "systems/local_contact_model.hpp"
#include "systems/overlap.hpp"
#include "systems/penetration.hpp"
#include "systems/picture_snapshot.hpp"
#include "systems/rasterise.hpp"
#include "systems/refit_trees.hpp"
#include "systems/rigid_motion.hpp"
#include "systems/surface_normals.hpp"
namespace trocar {

// Reused buffers of the systems; their content means nothing between passes but speed.
struct FrameScratch {
    CandidatePairsScratch pairs;
    RefitTreesScratch refit;
    RasteriseScratch rasterise;
    CandidateCellsScratch cells;
    OverlapScratch overlap;
    EdgePassScratch edges;
    ContactRowsScratch rows;
    IslandsScratch islands;
    SurfaceNormalsScratch normals;
};

struct FrameState {
    World world;
    FrameScratch scratch;
    FrameOptions options;
    FrameTimes times;
};

namespace {

double period_seconds(const World& w) { return w.clock.period * 1e-3; }

// adapters: unpack the world and call one system
void body_boxes(FrameState& f) { compute_body_boxes(period_seconds(f.world), surfaces_of(f.world), f.world.boxes); }
void candidate_pairs(FrameState& f) { find_candidate_pairs(f.world.bodies, f.world.boxes, {}, f.scratch.pairs, f.world.pairs); }
void refit(FrameState& f) { refit_trees(f.world.bodies, f.world.particles, f.world.pairs, f.scratch.refit, f.world.trees); }
void rasterise_(FrameState& f) {
    World& w = f.world;
    rasterise(w.settings.contact, surfaces_of(w), w.boxes, w.pairs, f.scratch.rasterise, w.report, w.screened, w.occupancy);
}
void candidate_cells(FrameState& f) {
    find_candidate_triangles(f.world.pairs, f.world.screened, f.world.occupancy, f.scratch.cells, f.world.candidates);
}
void overlap(FrameState& f) {
    World& w = f.world;
    find_overlap(surfaces_of(w), w.boxes, w.pairs, w.screened, w.candidates, w.trees, f.scratch.overlap, w.report, w.near, w.contacts);
}
void edge_pass(FrameState& f) {
    World& w = f.world;
    find_edge_contacts(w.settings.contact, surfaces_of(w), w.pairs, w.candidates, w.near, w.trees, f.scratch.edges, w.report, w.contacts);
}
void penetration(FrameState& f) { measure_penetrations(f.world.pairs, f.world.contacts, f.world.penetrations); }
void contact_rows(FrameState& f) {
    World& w = f.world;
    make_contact_rows(w.settings.contact, surfaces_of(w), w.pairs, w.contacts, w.penetrations, f.scratch.rows, w.report, w.rows);
}
void islands(FrameState& f) { find_islands(f.world.bodies, f.world.rows, f.scratch.islands, f.world.islands); }

}  // namespace
}  // namespace trocar
