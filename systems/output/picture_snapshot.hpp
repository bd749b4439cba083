#pragma once
#include <array>
#include <span>

#include "components/actions.hpp"
#include "components/contacts.hpp"
#include "components/fluid.hpp"
#include "components/haptics.hpp"
#include "components/links.hpp"
#include "components/nodes.hpp"
#include "components/picture.hpp"
#include "components/solids.hpp"
#include "components/spawning.hpp"
#include "components/tears.hpp"
#include "components/thread.hpp"
#include "engine/contact/sleeping_bodies.hpp"
#include "engine/fluid/film_shape.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

// Points of an effect that are drawn alike.
struct PicturePoints {
    std::span<const Vec3d> position;  // m, world
    double radius = 0;                // m
    std::array<float, 3> colour{};    // linear
};

struct PictureLiquidScratch {
    FilmShapeScratch scratch;
    FilmShape shape;
};

// Inputs of a picture.
struct PictureInputs {
    uint64_t number = 0;
    double time = 0;  // s
    Surfaces surfaces;
    const SurfaceNormals& normals;  // result of compute_surface_normals
    const Contacts& contacts;
    const Penetrations& penetrations;
    const Haptics& haptics;
    const Tears* tears = nullptr;           // triangles that cuts have removed; or null
    const SpawnState* spawning = nullptr;   // empty slots are not drawn; or null
    const NodeState* node_state = nullptr;  // nor are bodies of disabled nodes; or null
    std::span<const PicturePoints> points = {};
    const Links* links = nullptr;               // of the staples; or null
    const Actions* actions = nullptr;           // which bodies instruments may cut; or null
    const ActionState* action_state = nullptr;  // with it
    const Solids* solids = nullptr;             // to find the nodes of the links; or null
    const Fluids* fluids = nullptr;             // wet bodies; or null
    const FluidState* fluid_state = nullptr;    // with it
    PictureLiquidScratch* liquid = nullptr;     // with it
    double fog = 0;                             // of the lens: see PictureSnapshot
    const Threads* threads = nullptr;           // or null
    const ThreadState* thread_state = nullptr;  // with it
};

// Copies what a picture shows into `out`, whose capacity is reused. A vertex gets the deepest of its
// contacts; both ends of an edge contact get that contact's depth. Contacts outside (distance >= 0) count as
// depth zero. Non-finite vertices are copied unchanged and excluded from the boxes. Sleeping bodies copied
// already keep their elements of `out`.
void write_picture_snapshot(const PictureInputs& inputs, PictureSnapshot& out, const SleepingBodies& sleeping_bodies = {});

// The part of it that is no body's shape: effects' points, drops, staples, threads, smoke, liquid on surfaces, coagulated tissue.
// `out.body` has the prototype of every body and no `burnt` or `liquid`.
void write_picture_effects(const PictureInputs& inputs, PictureSnapshot& out);

}  // namespace trocar
